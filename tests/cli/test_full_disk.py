"""Each command that writes a file, on a disk that has no room for it: it says so and leaves nothing."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from analysis.registration.stack_file import read_stack, write_stack, write_truth
from cli.main import main
from instrument.files.json_file import write_json
from instrument.files.whole_file import InsufficientSpaceError
from tests.instrument.imports.folders import mosaic, write_capture, write_dng, write_exr
from tests.merl_files import write_materials
from tests.small_disk import fill, small_disk
from tests.synthetic import make_stack

# These would fit where there is room for the beginning of the others.
SMALL = {
    *("capture.toml", "figures.json", "checks.html", "documents.jsonl"),
    *("frame.png", "relit.exr", "relit.npy", "relit.png"),
}

RIG = """
name = "disk bench"
camera = { driver = "simulated", width = 96, height = 72, focal_length_px = 185.0 }
light = { driver = "simulated", offset_mm = [12.0, 0.0, 0.0], offset_sigma_mm = 3.0 }
stage = { driver = "simulated" }
geometry = { working_distance_mm = 350.0, area_mm = [60.0, 60.0] }
"""

CAMERA = ("--camera", "0,0,350", "--light", "100,0,300")

PLAIN = ("-q", "--left-out", "0", "--palette", "off", "--accuracy", "draft")

POSITIONS = ("--positions", "positions.csv", "--width-mm", "20")

COMMANDS = {
    "area.result.h5": ("reconstruct", "area.stack.h5", "-o", "NEW", *PLAIN),
    "relit.exr": ("render", "area.result.h5", *CAMERA, "-o", "NEW"),
    "relit.npy": ("render", "area.result.h5", *CAMERA, "-o", "NEW"),
    "relit.png": ("render", "area.result.h5", *CAMERA, "-o", "NEW"),
    "page.html": ("report", "area.result.h5", "-o", "NEW"),
    "session.h5": ("import", "pictures", "-o", "NEW"),
    "registered.stack.h5": ("import", "--registered", "views", *POSITIONS, "-o", "NEW"),
    "capture.toml": ("import", "--init", "DISK"),
    "packed.h5": ("session", "pack", "leaf.h5", "-o", "NEW"),
    "exported": ("session", "export", "leaf.h5", "-o", "NEW"),
    "documents.jsonl": ("session", "documents", "leaf.h5", "-o", "NEW"),
    "checks.html": ("calibrate", "leaf.h5", "-q", "--report", "NEW"),
    "figures.json": ("calibrate", "leaf.h5", "-q", "--json", "NEW"),
    "new.dictionary.h5": ("dictionary", "build", "merl", "-o", "NEW", "-q"),
    "frame.png": ("rig", "frame", "rig.toml", "--exposure-time", "0.02", "-o", "NEW"),
}  # fmt: skip


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the commands read."""
    folder = tmp_path_factory.mktemp("sources")
    (folder / "rig.toml").write_text(RIG)
    write_stack(folder / "area.stack.h5", make_stack(n_views=12, size=16))
    assert run("reconstruct", folder / "area.stack.h5", "-o", folder / "area.result.h5", *PLAIN) == 0
    (folder / "pictures").mkdir()
    for i in range(4):
        write_dng(folder / "pictures" / f"{i}.dng", mosaic(i), (0.01, 0.1)[i % 2])
    write_capture(folder / "pictures", 'name = "leaf"\n')
    assert run("import", folder / "pictures", "-o", folder / "leaf.h5") == 0
    write_materials(folder / "merl", alum_bronze=2)
    _write_views(folder / "views")
    return folder


def _write_views(folder: Path) -> None:
    folder.mkdir()
    lines = ["file,camera_x_mm,camera_y_mm,camera_z_mm,light_x_mm,light_y_mm,light_z_mm"]
    for i in range(3):
        write_exr(folder / f"{i}.exr", np.random.default_rng(i).uniform(0.1, 1.0, (48, 48, 3)).astype(np.float32), 1.0)
        lines.append(f"{i}.exr,{i},0,300,{i + 5},0,300")
    (folder / "positions.csv").write_text("\n".join(lines))


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk(tmp_path / "disk", "128k") as folder:
        yield folder


def run(*arguments: str | Path) -> int:
    """Run `halfangle` and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_leaves_nothing_on_a_full_disk_and_names_its_file(
    name: str, sources: Path, disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if name == "capture.toml":
        shutil.copy(sources / "pictures" / "0.dng", disk)
    fill(disk, 0 if name in SMALL else 12 * 1024)
    before = sorted(disk.iterdir())
    places = {"NEW": disk / name, "DISK": disk} | {path.name: path for path in sources.iterdir()}
    assert run(*(places.get(word, word) for word in COMMANDS[name])) == 1
    assert sorted(disk.iterdir()) == before
    told = capsys.readouterr().err
    assert f"halfangle: {disk / name}" in told
    assert "is not written: disk full; it needs" in told
    assert "Free some space" in told


def test_every_one_of_them_writes_its_file_where_there_is_room(sources: Path, tmp_path: Path) -> None:
    shutil.copy(sources / "pictures" / "0.dng", tmp_path)
    for name, words in COMMANDS.items():
        places = {"NEW": tmp_path / name, "DISK": tmp_path} | {path.name: path for path in sources.iterdir()}
        assert run(*(places.get(word, word) for word in words)) in {0, 3}, name
        assert (tmp_path / name).exists()
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_stack_to_which_no_truth_can_be_added_is_as_it_was(sources: Path, disk: Path) -> None:
    path = disk / "small.stack.h5"
    stack = make_stack(n_views=2, size=16)
    assert stack.truth is not None
    write_stack(path, make_stack(n_views=2, size=16))
    before = path.read_bytes()
    fill(disk, 8 * 1024)
    with pytest.raises(InsufficientSpaceError, match=r"small\.stack\.h5 is not written: disk full"):
        write_truth(path, stack.truth)
    assert path.read_bytes() == before
    assert sorted(disk.iterdir()) == [disk / "others", path]
    assert read_stack(path).n_views == 2


def test_json_that_takes_the_place_of_an_earlier_one_leaves_that_on_a_full_disk(disk: Path) -> None:
    write_json(disk / "a.json", {"seed": 1})
    fill(disk, 0)
    with pytest.raises(InsufficientSpaceError, match=r"a\.json is not written: disk full; it needs 10 kB"):
        write_json(disk / "a.json", {"seed": 2, "more": "x" * 10_000}, overwrite=True)
    assert '"seed": 1' in (disk / "a.json").read_text()
    assert sorted(disk.iterdir()) == [disk / "a.json", disk / "others"]
