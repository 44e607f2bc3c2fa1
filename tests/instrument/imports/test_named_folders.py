"""Folders called views, darks and flats are read as what they are called."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from instrument.files.validation import InvalidInputError
from instrument.imports.prepare import Import, prepare_import
from instrument.imports.template import capture_template
from tests.instrument.imports.folders import TIMES, H, W, mosaic, refused, write_capture, write_dng, write_jpeg

PIXELS = np.full((H, W, 3), 100, np.uint8)


@pytest.fixture
def named(tmp_path: Path) -> Path:
    """Two brackets of views, with darks and flats."""
    for name, n in (("views", 4), ("darks", 2), ("flats", 1)):
        (tmp_path / name).mkdir()
        for i in range(n):
            write_dng(tmp_path / name / f"{name[0]}{i}.dng", mosaic(i), TIMES[i % 2])
    return tmp_path


def names(prepared: Import) -> dict[str, list[str]]:
    arrangement = prepared.arrangement
    frames = {"views": arrangement.frames, "darks": arrangement.darks, "flats": arrangement.flats}
    return {key: [frame.pick.name for frame in found] for key, found in frames.items()}


EXPECTED = {
    "views": [f"views/v{i}.dng" for i in range(4)],
    "darks": ["darks/d0.dng", "darks/d1.dng"],
    "flats": ["flats/f0.dng"],
}


def unstated(folder: Path) -> str:
    """Return what an import without a capture.toml is refused with."""
    with pytest.raises(InvalidInputError) as caught:
        prepare_import(folder)
    return str(caught.value)


def test_the_folders_say_what_is_what_without_a_capture_file(named: Path) -> None:
    prepared = prepare_import(named)
    assert names(prepared) == EXPECTED
    assert [len(pose) for pose in prepared.arrangement.poses] == [2, 2]


def test_init_writes_the_folders_down(named: Path) -> None:
    text = capture_template(named)
    assert 'glob = "views/*.dng"  # fits 4' in text
    assert '\n[darks]\nfiles = ["darks/*.dng"]  # fits 2' in text
    assert names(prepare_import(named, write_capture(named, text))) == EXPECTED


def test_a_capture_file_comes_before_the_names_of_folders(named: Path) -> None:
    write_capture(named, 'name = "leaf"\n[grouping]\nglob = "views/*"\nby = "exposure"\n')
    assert names(prepare_import(named)) == EXPECTED | {"darks": [], "flats": []}


def test_capital_letters_and_folders_of_poses_mean_the_same(named: Path) -> None:
    (named / "views").rename(named / "old")
    for i in range(2):
        (named / "Views" / f"pose_{i}").mkdir(parents=True)
        for k in range(2):
            (named / "old" / f"v{2 * i + k}.dng").rename(named / "Views" / f"pose_{i}" / f"{k}.dng")
    (named / "darks").rename(named / "DARKS")
    found = names(prepare_import(named))
    assert found["views"] == [f"Views/pose_{i}/{k}.dng" for i in range(2) for k in range(2)]
    assert found["darks"] == ["DARKS/d0.dng", "DARKS/d1.dng"]


def test_darks_of_the_views_kind_are_taken_where_there_are_several(named: Path) -> None:
    for path in (named / "views").iterdir():
        path.unlink()
    write_jpeg(named / "views" / "v0.jpg", PIXELS, TIMES[0])
    write_jpeg(named / "darks" / "d0.jpg", PIXELS, TIMES[0])
    assert 'files = ["darks/*.jpg"]  # fits 1' in capture_template(named)


def test_views_beside_darks_need_no_folder_of_their_own(named: Path) -> None:
    for path in (named / "views").iterdir():
        path.rename(named / path.name)
    (named / "views").rmdir()
    assert "there is no such file; `halfangle import --init" in unstated(named)
    found = names(prepare_import(named, write_capture(named, capture_template(named))))
    assert found == EXPECTED | {"views": [f"v{i}.dng" for i in range(4)]}


def test_pictures_beside_the_folders_are_told(named: Path) -> None:
    write_dng(named / "card.dng", mosaic(7), TIMES[0])
    told = "1 picture lies beside the folder views (card.dng)"
    assert f"{told}, and nothing says what they are" in unstated(named)
    assert f"# {told}: name them here" in capture_template(named)


def test_two_folders_of_one_name_are_told(named: Path) -> None:
    (named / "Darks").mkdir()
    if len(list(named.iterdir())) < 4:
        pytest.skip("this file system does not tell capital letters apart")
    assert "there are the folders Darks and darks; which one is meant?" in unstated(named)
    with pytest.raises(InvalidInputError, match="which one is meant"):
        capture_template(named)


@pytest.mark.parametrize("name", ["views", "darks", "flats"])
def test_a_folder_without_a_picture_is_told(named: Path, name: str) -> None:
    for path in (named / name).iterdir():
        path.unlink()
    assert f"{name}: the folder holds no picture" in unstated(named)


def test_what_the_folders_cannot_say_needs_a_capture_file(named: Path) -> None:
    write_dng(named / "views" / "v4.dng", mosaic(4), None)
    message = unstated(named)
    assert "needs a capture.toml; `halfangle import --init" in message
    assert "views/v4.dng: does not say its exposure time" in message
    for path in (named / "views").iterdir():
        path.unlink()
    write_jpeg(named / "views" / "v0.jpg", PIXELS, TIMES[0])
    assert "capture.toml as --init would write it" in unstated(named)
    assert "exactly one of gamma, curve and bracket" in unstated(named)


def test_a_glob_that_takes_darks_for_views_is_told(named: Path) -> None:
    message = refused(named, 'name = "leaf"\n[grouping]\nglob = "*/*.dng"\nby = "exposure"\n')
    assert (
        "capture.toml:3: grouping.glob: '*/*.dng' takes 2 of the folder darks for views; name them in [darks]"
        in message
    )
    assert "takes 1 of the folder flats for views" in message
    on_purpose = write_capture(named, 'name = "leaf"\n[grouping]\nglob = "darks/*.dng"\n')
    assert len(prepare_import(named, on_purpose).arrangement.poses) == 2
