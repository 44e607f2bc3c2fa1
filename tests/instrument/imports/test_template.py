import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from instrument.config.capture_config import load_capture
from instrument.config.proposed_boards import proposed_boards
from instrument.files.validation import InvalidInputError
from instrument.imports.prepare import prepare_import
from instrument.imports.template import capture_template
from tests.instrument.imports.folders import H, W, mosaic, write_capture, write_dng, write_jpeg, write_png

PIXELS = np.random.default_rng(0).integers(0, 256, (H, W, 3)).astype(np.uint8)


def uncommented(text: str) -> str:
    """Switch every line on that is a key or a table in a comment."""
    is_off = re.compile(r"^# (?=\[+\w+\]|\w+ = )")
    return "\n".join(is_off.sub("", line) for line in text.splitlines())


def test_what_is_written_for_raw_brackets_imports_without_an_edit(tmp_path: Path) -> None:
    for i in range(6):
        write_dng(tmp_path / f"IMG_{i}.dng", mosaic(i), (0.01, 0.1)[i % 2])
    text = capture_template(tmp_path)
    assert "# Poses: 3, of pictures each: 2, of 0.01 to 0.1 s." in text
    assert '# bayer_pattern = "RGGB"  # as the pictures say' in text
    assert "# black_level = [64.0, 65.0, 66.0, 67.0]  # as the pictures say" in text
    prepared = prepare_import(tmp_path, write_capture(tmp_path, text))
    assert [len(pose) for pose in prepared.arrangement.poses] == [2, 2, 2]


def test_a_folder_for_each_pose_is_found(tmp_path: Path) -> None:
    for pose in ("pose_2", "pose_10"):
        (tmp_path / pose).mkdir()
        for i, time in enumerate((0.01, 0.1)):
            write_dng(tmp_path / pose / f"{i}.dng", mosaic(i), time)
    prepared = prepare_import(tmp_path, write_capture(tmp_path, capture_template(tmp_path)))
    names = [[frame.pick.name for frame in pose] for pose in prepared.arrangement.poses]
    assert names == [["pose_2/0.dng", "pose_2/1.dng"], ["pose_10/0.dng", "pose_10/1.dng"]]


def test_raw_files_come_before_the_jpegs_beside_them(tmp_path: Path) -> None:
    for i in range(2):
        write_dng(tmp_path / f"IMG_{i}.dng", mosaic(i), 0.1)
        write_jpeg(tmp_path / f"IMG_{i}.jpg", PIXELS, 0.1)
    prepared = prepare_import(tmp_path, write_capture(tmp_path, capture_template(tmp_path)))
    assert [pose[0].pick.name for pose in prepared.arrangement.poses] == ["IMG_0.dng", "IMG_1.dng"]


def test_pictures_without_a_time_import_with_one_to_be_corrected(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", mosaic(0))
    text = capture_template(tmp_path)
    assert "exposure_times_s = [1.0]  # 1 of them do not say it: state the true time" in text
    assert prepare_import(tmp_path, write_capture(tmp_path, text)).arrangement.exposure_times == (1.0,)


def test_pictures_for_display_are_refused_until_a_curve_is_chosen(tmp_path: Path) -> None:
    write_jpeg(tmp_path / "a.jpg", PIXELS, 0.1)
    text = capture_template(tmp_path)
    with pytest.raises(InvalidInputError, match="exactly one of gamma, curve and bracket; here are none"):
        load_capture(write_capture(tmp_path, text))
    chosen = text.replace('# gamma = "srgb"', 'gamma = "srgb"')
    assert prepare_import(tmp_path, write_capture(tmp_path, chosen)).response is not None


def test_every_key_that_stands_in_a_comment_is_one(tmp_path: Path) -> None:
    write_dng(tmp_path / "a.dng", mosaic(0), 0.1)
    text = uncommented(capture_template(tmp_path))
    # Lines that contradict each other on purpose.
    text = text.replace("linear = false", "").replace("frames_per_pose = 3", "")
    config = load_capture(write_capture(tmp_path, text))
    assert config.area is not None
    assert config.light is not None
    assert config.darks is not None
    assert tuple(board.record for board in config.boards) == proposed_boards((60.0, 60.0))


def test_the_focal_length_is_guessed_from_that_in_35_mm_film(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 50
    Image.fromarray(PIXELS).save(tmp_path / "a.jpg", exif=exif)
    expected = 50 / np.hypot(36, 24) * np.hypot(H, W)
    assert f"focal_length_px = {expected:.0f}  # as the pictures say" in capture_template(tmp_path)


def test_a_folder_without_a_picture_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    with pytest.raises(InvalidInputError, match="holds no picture"):
        capture_template(tmp_path)
    (tmp_path / "a.dng").write_bytes(b"nothing")
    with pytest.raises(InvalidInputError, match=r"a.dng: cannot be read"):
        capture_template(tmp_path)
