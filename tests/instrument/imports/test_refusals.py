"""What is wrong with a folder or its `capture.toml` is said, all of it, with its place."""

from pathlib import Path

import numpy as np
import pytest

from tests.instrument.imports.folders import H, W, imported, mosaic, refused, write_dng, write_jpeg


def test_every_damaged_or_missing_picture_is_named_at_once(brackets: Path) -> None:
    for name in ("IMG_9.dng", "IMG_11.dng"):
        (brackets / name).write_bytes((brackets / name).read_bytes()[:2000])
    write_dng(brackets / "IMG_20.dng", mosaic(0), None)
    poses = ['[[poses]]\nfiles = ["IMG_9.dng", "IMG_11.dng"]', '[[poses]]\nfiles = ["IMG_20.dng", "IMG13.dng"]']
    message = refused(brackets, "\n".join(['name = "leaf"', *poses]))
    assert "IMG_9.dng: cannot be read" in message
    assert "IMG_11.dng: cannot be read" in message
    assert "IMG_20.dng: does not say its exposure time; state it as exposure_times_s of poses[1]" in message
    assert "capture.toml:5: poses[1].files[1]: 'IMG13.dng' is not in" in message
    assert "did you mean 'IMG_13.dng'?" in message


def test_pictures_of_other_settings_are_named(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (H, W, 3)).astype(np.uint8)
    for i in range(3):
        write_jpeg(tmp_path / f"{i}.jpg", pixels, 0.1)
    write_jpeg(tmp_path / "3.jpg", pixels, 0.1, iso=200, f_number=2.8, balance=0)
    write_jpeg(tmp_path / "4.jpg", pixels[:, : W // 2], 0.1)
    message = refused(tmp_path, 'name = "leaf"\nresponse = { gamma = "srgb" }\n')
    for expected in (
        "3.jpg: its ISO is 200 and that of other pictures 100; all must be alike",
        "3.jpg: its f-number is 2.8 and that of other pictures 8",
        "3.jpg: its white balance is Auto and that of other pictures Manual",
        "4.jpg: its size is 32 x 48 pixels with 3 channels and that of other pictures 64 x 48 pixels",
    ):
        assert expected in message


def test_eight_bits_without_a_curve_are_refused_with_the_remedy(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (H, W, 3)).astype(np.uint8)
    write_jpeg(tmp_path / "a.jpg", pixels, 0.1)
    message = refused(tmp_path, 'name = "leaf"\n')
    assert "not proportional to light; add [response] with gamma = 2.2" in message
    assert "set linear = true" in message
    with imported(tmp_path, 'name = "leaf"\nlinear = true\n') as session:
        assert (session.camera.bit_depth, session.camera.saturation_value) == (8, 255)
        assert session.nominal.response is None


CHECKERBOARD = '[[boards]]\nkind = "checkerboard"\nsquares = [3, 3]\nsquare_mm = 5\n'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('sampel = "b"', "capture.toml:2: unknown key 'sampel'; did you mean 'sample'?"),
        ("linear = false", "capture.toml:2: the pictures are not linear; add [response]"),
        ("linear = true\n[response]\ngamma = 2", "capture.toml:3: linear is true"),
        ('[response]\ngamma = "sRGB"', 'response.gamma is "sRGB"; allowed: a number from 0.2 to 5, or "srgb"'),
        ('[response]\ngamma = 2\ncurve = "b"', "exactly one of gamma, curve and bracket; here are gamma, curve"),
        ("[camera]\nblack_level = [1, 2]", "one number, or a list of four"),
        ('[camera]\nbayer_pattern = "RGBG"', "allowed: 'RGGB', 'BGGR', 'GRBG', 'GBRG' or ''"),
        ('[grouping]\nby = "time"', "capture.toml:3: grouping.by is \"time\"; allowed: 'exposure'"),
        ('[grouping]\nby = "exposure"\nframes_per_pose = 3', "exclude each other; keep one"),
        ("[grouping]\nframes_per_pose = 3\nexposure_times_s = [1]", "has 1 elements; a pose has 3 pictures"),
        ("[grouping]\nframes_per_pose = 4", "there are 6 pictures, which are no whole poses of 4"),
        ('[grouping]\nglob = "*.nef"', "capture.toml:3: grouping.glob: no picture in"),
        ('[[poses]]\nfiles = ["/etc/hosts"]', "capture.toml:3: poses[0].files[0]: '/etc/hosts' is no name within"),
        ('[[poses]]\nfiles = ["*.d["]', "'*.d[' is not in"),
        ('[[poses]]\nfiles = ["**x/*.dng"]', "poses[0].files[0]: "),
        ('[grouping]\n[[poses]]\nfiles = ["a"]', "[[poses]] and [grouping] exclude each other"),
        ("[[poses]]\nfiles = []", "poses[0].files is []; it must"),
        ('[[poses]]\nfiles = ["IMG_8.dng"]\nexposure_times_s = [1, 2]', "1 pictures and 2 exposure times"),
        ('[[poses]]\nfiles = ["IMG_8.dng"]\nexposure_times_s = [-1]', "it must be greater than 0"),
        ('[[poses]]\nfiles = ["IMG_8.dng"]\n[[poses]]\nfiles = ["*8.dng"]', "IMG_8.dng stands at poses[0]"),
        ('[[poses]]\nfiles = ["IMG_8.dng", "IMG_10.dng"]', "in the same pose (0); a bracket has each time once"),
        ("[camera]\nbit_depth = 8", "capture.toml:2: camera: bit_depth is 8, but the pictures hold"),
        ("[camera]\nblack_level = 5000", "black_level is 5000 and saturation_level 4095; black must be less"),
        ('[darks]\nfiles = ["IMG_8.dng"]', "darks: no dark frame of 0.1 s; take them"),
        ('linear = false\n[response]\ncurve = "c.csv"', "capture.toml:4: response.curve: c.csv cannot be read"),
        ('[flats]\nfiles = ["IMG_8.dng"]\ndistance_mm = [1, 2]', "there are 2 distances for 1 pictures"),
        ("focal_length_px = 9\n[intrinsics]\nfx = 9\nfy = 9\ncx = 1\ncy = 1", "leave focal_length_px out"),
        (CHECKERBOARD + 'corner_mm = "measured"', 'or "measure"'),
        (CHECKERBOARD.replace("checkerboard", "charuco") + "corner_mm = [0, 0]", "add dictionary, first_id, marker_mm"),
        (
            CHECKERBOARD + 'corner_mm = [0, 0]\ndictionary = "DICT_4X4_50"',
            "a checkerboard has no markers; leave out dictionary",
        ),
        (
            "area = { width_mm = 9, height_mm = 9 }\n" + CHECKERBOARD + "corner_mm = [0, 0]",
            "capture.toml:7: boards[0].corner_mm: the board covers x 0 to 15, y -15 to 0 mm, which overlaps the [area]",
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_place_and_the_remedy(brackets: Path, text: str, expected: str) -> None:
    assert expected in refused(brackets, f'name = "a"\n{text}')


def test_all_that_is_wrong_with_the_settings_is_said_at_once(brackets: Path) -> None:
    text = 'nam = "a"\nlinear = false\n[camera]\nbit_depth = 99\n[[boards]]\nkind = "checker"\n'
    message = refused(brackets, text)
    for expected in ("'name' is missing", "unknown key 'nam'", "[response]", "bit_depth is 99", "boards[0].kind"):
        assert expected in message
