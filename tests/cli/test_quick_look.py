import json
from pathlib import Path

import h5py
import pytest
from PIL import Image

from cli.main import main
from instrument.config.loading import load_protocol, load_rig
from instrument.session import layout
from protocols.capture.engine import Control, Progress, capture
from tests.quick_session import write_files


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`few.h5` with three poses, `some.h5` with six; both are interrupted."""
    folder = tmp_path_factory.mktemp("quick")
    rig_file, protocol_file = write_files(folder)
    # Nobody looks at the accuracy here.
    small = (
        rig_file.read_text().replace("width = 192, height = 192", "width = 48, height = 48").replace("420.0", "105.0")
    )
    rig_file.write_text(small)
    for name, n_poses in (("few", 3), ("some", 6)):
        control = Control()

        def pause(progress: Progress, n_poses: int = n_poses, control: Control = control) -> None:
            if progress.message.startswith(f"took pose {n_poses} "):
                control.pause()

        capture(load_rig(rig_file), load_protocol(protocol_file), folder / f"{name}.h5", pause, control=control)
    return folder


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in ("session", "quick-look", *arguments)])
    return int(caught.value.code or 0)


def test_an_interrupted_session_is_looked_at(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder / "some.h5") == 0
    text = capsys.readouterr().out
    assert "some.h5: 6 of 20 poses" in text
    assert "of 4096 cells" in text
    assert "one more pose would help most at tilt" in text


def test_json_says_the_same_beside_a_picture(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = folder / "some.png"
    assert run(folder / "some.h5", "--json", "-o", picture) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["poses_used"] == list(range(6))
    assert (found["n_poses"], found["problems"], found["solved_share"]) == (20, [], 1.0)
    assert found["next_pose"]["error_deg"] < found["next_pose"]["error_without_deg"]
    with Image.open(picture) as opened:
        assert opened.size[0] > 500


def test_too_few_poses_are_told_with_exit_3_and_no_picture(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder / "few.h5") == 3
    assert "none yet: 3 views; at least 4 are needed" in capsys.readouterr().out
    assert run(folder / "few.h5", "-o", folder / "few.png") == 2
    assert "few.png was not written" in capsys.readouterr().err
    assert not (folder / "few.png").exists()


def test_a_picture_is_not_overwritten(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "old.png").write_text("old")
    assert run(folder / "some.h5", "-o", folder / "old.png") == 2
    assert "is not overwritten" in capsys.readouterr().err
    assert (folder / "old.png").read_text() == "old"


def test_a_file_that_is_no_session_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "text.h5").write_text("no session")
    assert run(folder / "text.h5") == 2
    assert "is not a usable session" in capsys.readouterr().err


def test_a_stage_whose_axes_ride_on_nothing_is_refused_with_the_path(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.h5"
    path.write_bytes((folder / "some.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        file[layout.axis_field("turn", "value").path].attrs["depends_on"] = "nowhere"
    assert run(path) == 2
    assert "/entry/instrument/stage/turn/value: depends_on leads to no base" in capsys.readouterr().err
