"""Whatever is lost, the poses that are good are found, and the file stays as it is."""

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from instrument.files import child
from instrument.files.validation import InvalidInputError
from instrument.session import layout
from instrument.session_tools.examination import examination
from instrument.session_tools.summary import summarise_all
from protocols.capture.engine import capture
from tests.instrument.conftest import Change
from tests.protocols import fakes
from tests.protocols.fakes import FakeBench, protocol_config, rig_config
from tests.strangers.traps import crashing, endless


@pytest.fixture(scope="module")
def large_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session whose frames are most of it, as those of a real camera are."""
    path = tmp_path_factory.mktemp("large") / "s.h5"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fakes, "HEIGHT", 160)
        patch.setattr(fakes, "WIDTH", 240)
        capture(rig_config(), protocol_config(count=6), path, devices=FakeBench().devices)
    return path


def frames_end(path: Path) -> list[int]:
    """Return where in the file the last byte of each pose's frames lies."""
    with h5py.File(path) as file:
        images = file[layout.IMAGES.path].id
        ends = np.zeros(images.shape[0], int)
        for i in range(images.get_num_chunks()):
            chunk = images.get_chunk_info(i)
            ends[chunk.chunk_offset[0]] = max(ends[chunk.chunk_offset[0]], chunk.byte_offset + chunk.size)
    return ends.tolist()


def test_a_sound_session_is_good_throughout(session_path: Path) -> None:
    found = examination(session_path)
    assert (found.n_poses, found.good, found.missing, found.problems) == (3, [0, 1, 2], [], [])


@pytest.mark.parametrize("share", [0.7, 0.999])
def test_of_a_file_that_is_cut_short_the_poses_before_the_cut_are_good(
    large_path: Path, tmp_path: Path, share: float
) -> None:
    content = large_path.read_bytes()
    size = int(share * len(content))
    (tmp_path / "cut.h5").write_bytes(content[:size])
    before = (tmp_path / "cut.h5").stat().st_mtime_ns
    found = examination(tmp_path / "cut.h5")
    assert found.good == [i for i, end in enumerate(frames_end(large_path)) if end <= size]
    assert f"is cut short: the last {len(content) - size} of {len(content)} bytes are missing" in str(found.problems[0])
    assert (tmp_path / "cut.h5").read_bytes() == content[:size]
    assert (tmp_path / "cut.h5").stat().st_mtime_ns == before


def test_a_file_of_which_too_little_is_left_is_refused(session_path: Path, tmp_path: Path) -> None:
    for size in (0, 1000):
        (tmp_path / "cut.h5").write_bytes(session_path.read_bytes()[:size])
        with pytest.raises(InvalidInputError, match=r"not an HDF5 file|damaged"):
            examination(tmp_path / "cut.h5")


def test_a_pose_that_ends_its_reader_does_not_hide_the_others(session_path: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.h5"
    shutil.copy(session_path, path)
    crashing(path, i_pose=1)
    found = examination(path)
    assert found.good == [0, 2]
    assert [str(problem) for problem in found.problems] == [
        "/entry/instrument/camera/images[1]: the file is damaged: a process that was reading this crashed (SIGSEGV)"
    ]


def test_poses_are_good_even_if_the_rest_is_not(changed: Callable[[Change], Path]) -> None:
    def ruin(file: h5py.File) -> None:
        del file[layout.TIMESTAMP.path]
        file[layout.IMAGES.path][2, 0, 0, 0] ^= 1

    found = examination(changed(ruin))
    assert found.good == [0, 1]
    assert [problem.where for problem in found.problems] == [layout.TIMESTAMP.path, layout.IMAGES.path]


def test_a_file_that_ends_its_reader_is_a_row_among_the_others(
    session_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child, "STEP_SECONDS", 0.3)
    paths = [tmp_path / f"{i}.h5" for i in range(3)]
    for path in paths:
        shutil.copy(session_path, path)
    endless(paths[1])
    rows = summarise_all(paths)
    assert [row["state"] for row in rows] == ["complete", "damaged", "complete"]
    assert "did not come to an end" in rows[1]["problems"][0][1]
