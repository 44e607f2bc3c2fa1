"""What public bug reports of people who do this job hold: read as it is meant, or refused with the remedy."""

from __future__ import annotations

import unicodedata
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tifffile
from PIL import Image

from analysis.registration.stack_file import read_stack, write_stack
from analysis.results.result_file import read_result
from cli.main import main
from instrument.files.validation import InvalidInputError
from instrument.imports.finder import Finder
from instrument.imports.prepare import CAPTURE_FILE, prepare_import
from instrument.imports.response_curve import read_curve
from instrument.imports.template import capture_template
from instrument.pictures.exif import read_shot
from instrument.pictures.picture import UnreadablePictureError
from instrument.pictures.reading import is_picture, read_picture
from instrument.session.session import Session
from protocols.planning.python_protocol import MAX_POSES, load_python_protocol
from tests.instrument.imports.folders import H, W, mosaic, write_dng
from tests.synthetic import make_stack

RGB16 = np.random.default_rng(0).integers(0, 65_536, (H, W, 3)).astype(np.uint16)


def exit_code(*arguments: str | Path) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


def test_floating_point_dngs_are_refused_since_each_would_be_scaled_to_its_own_maximum(tmp_path: Path) -> None:
    for i, brightest in enumerate((1.0, 0.5)):
        values = np.full((H, W), 0.25, np.float32)
        values[0, 0] = brightest
        path = tmp_path / f"{i}.dng"
        tifffile.imwrite(path, values, photometric=32803, metadata=None)
        with pytest.raises(UnreadablePictureError, match=r"floating-point values.*save it as EXR"):
            read_picture(path)


@pytest.mark.parametrize(
    ("photometric", "tags", "told"),
    [
        (34892, [(50714, "H", 3, (100, 200, 300), True)], "black levels 100, 200, 300"),
        (34892, [(50714, "2I", 3, (100, 1, 100, 1, 250, 1), True)], "black levels 100, 100, 250"),
        (32803, [(50713, "H", 2, (4, 4), True), (50714, "H", 16, tuple(range(16)), True)], "a pattern of 4 x 4"),
    ],
)
def test_black_levels_that_are_not_handed_on_whole_are_refused(
    tmp_path: Path, photometric: int, tags: list[Any], told: str
) -> None:
    pixels = RGB16 if photometric == 34892 else RGB16[..., 0]
    tifffile.imwrite(tmp_path / "a.dng", pixels, photometric=photometric, extratags=tags, metadata=None)
    with pytest.raises(UnreadablePictureError, match=told):
        read_picture(tmp_path / "a.dng")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_tiff_with_white_as_zero_is_turned_round(tmp_path: Path, dtype: Any) -> None:
    light = (RGB16[..., 0] >> (16 - 8 * np.dtype(dtype).itemsize)).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", np.iinfo(dtype).max - light, photometric="miniswhite")
    np.testing.assert_array_equal(read_picture(tmp_path / "a.tif").pixels, light)


def test_a_compressed_tiff_with_white_as_zero_is_never_turned_round_twice(tmp_path: Path) -> None:
    light = (RGB16[..., 0] >> 8).astype(np.uint8)
    Image.fromarray(255 - light).save(tmp_path / "a.tif", compression="tiff_lzw", tiffinfo={262: 0})
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.pages.first.photometric == tifffile.PHOTOMETRIC.MINISWHITE
    with pytest.raises(UnreadablePictureError, match="white as 0 and is compressed; save it uncompressed"):
        read_picture(tmp_path / "a.tif")


@pytest.mark.parametrize(("kind", "channels"), [("separated", 4), ("cielab", 3), ("ycbcr", 3)])
def test_a_tiff_of_other_colours_is_refused_by_their_name(tmp_path: Path, kind: str, channels: int) -> None:
    pixels = np.zeros((H, W, channels), np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric=kind)
    with pytest.raises(UnreadablePictureError, match=f"colours of the kind {kind.upper()}; save it as RGB"):
        read_picture(tmp_path / "a.tif")


def test_a_palette_is_refused(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((H, W), np.uint8)).convert("P").save(tmp_path / "a.tif")
    with pytest.raises(UnreadablePictureError, match="colours of the kind PALETTE"):
        read_picture(tmp_path / "a.tif")


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_a_transparent_picture_is_refused_and_an_opaque_one_taken(tmp_path: Path, name: str) -> None:
    pixels = np.full((H, W, 4), 255, np.uint8)
    pixels[..., :3] = (RGB16 >> 8).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / name)
    np.testing.assert_array_equal(read_picture(tmp_path / name).pixels, pixels[..., :3])
    pixels[3, 4, 3] = 200
    Image.fromarray(pixels).save(tmp_path / name)
    with pytest.raises(UnreadablePictureError, match=r"transparent in places.*flatten it"):
        read_picture(tmp_path / name)


@pytest.mark.parametrize(("apex", "seconds"), [(6, 1 / 64), (1, 0.5), (0, 1.0)])
def test_a_time_stated_as_shutter_speed_value_only_is_read(tmp_path: Path, apex: int, seconds: float) -> None:
    image, tags = Image.fromarray((RGB16 >> 8).astype(np.uint8)), Image.Exif()
    tags.get_ifd(0x8769)[0x9201] = apex
    image.save(tmp_path / "a.jpg", exif=tags)
    assert read_shot(tmp_path / "a.jpg").exposure_time == pytest.approx(seconds)


def imported(folder: Path) -> list[str]:
    (folder / CAPTURE_FILE).write_text(capture_template(folder), encoding="utf-8")
    prepared = prepare_import(folder, folder / CAPTURE_FILE)
    return [frame.pick.name for pose in prepared.arrangement.poses for frame in pose]


def test_hidden_files_of_a_mac_are_left_alone(tmp_path: Path) -> None:
    for i in range(2):
        write_dng(tmp_path / f"IMG_{i}.dng", mosaic(i), 0.01)
        (tmp_path / f"._IMG_{i}.dng").write_bytes(b"\0\5\26\7")
    assert imported(tmp_path) == ["IMG_0.dng", "IMG_1.dng"]
    assert not is_picture(tmp_path / "._IMG_0.dng")


def test_endings_in_capitals_and_small_letters_are_one_kind(tmp_path: Path) -> None:
    for i, name in enumerate(("IMG_0.DNG", "IMG_1.dng", "IMG_2.DNG")):
        write_dng(tmp_path / name, mosaic(i), 0.01)
    assert imported(tmp_path) == ["IMG_0.DNG", "IMG_1.dng", "IMG_2.DNG"]


def test_a_name_in_decomposed_letters_is_found_by_the_composed_one(tmp_path: Path) -> None:
    write_dng(tmp_path / unicodedata.normalize("NFD", "Blätter.dng"), mosaic(0), 0.01)
    composed = unicodedata.normalize("NFC", "Blätter.dng")
    finder = Finder(tmp_path)
    (pick,) = finder.find([composed], None, ("poses", "files"))
    assert pick.path.is_file()
    assert finder.complaints == []


def test_a_folder_with_an_emoji_gets_a_capture_file_that_can_be_read(tmp_path: Path) -> None:
    folder = tmp_path / "Blatt 🍂"
    folder.mkdir()
    write_dng(folder / "a.dng", mosaic(0), 0.01)
    assert imported(folder) == ["a.dng"]


def test_a_curve_with_semicolons_and_decimal_commas_is_read(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("count;linear\n0;0\n128;0,25\n255;1,0\n")
    assert read_curve(tmp_path / "c.csv", 256)[0, 128] == pytest.approx(0.25)


def test_a_decimal_comma_in_toml_is_named(tmp_path: Path) -> None:
    (tmp_path / CAPTURE_FILE).write_text('name = "x"\n[light]\noffset_sigma_mm = 3,0\n')
    with pytest.raises(InvalidInputError, match=r"capture.toml:3: .*a decimal comma\? TOML has the decimal point"):
        prepare_import(tmp_path, tmp_path / CAPTURE_FILE)


def test_letters_of_any_language_go_out_with_an_export_and_come_back(tmp_path: Path) -> None:
    folder = tmp_path / "leaf"
    folder.mkdir()
    write_dng(folder / "a.dng", mosaic(0), 0.01)
    words = 'name = "t"\nsample = "leaf 🍂"\nlinear = true\n[camera]\nmake = "Größe"\nserial_number = "Ä1"\n'
    (folder / CAPTURE_FILE).write_text(words, encoding="utf-8")
    assert exit_code("import", folder, "-o", tmp_path / "a.h5") == 0
    assert exit_code("session", "export", tmp_path / "a.h5", "-o", tmp_path / "out") == 0
    assert exit_code("import", tmp_path / "out", "-o", tmp_path / "b.h5") == 0
    for name in ("a.h5", "b.h5"):
        with Session(tmp_path / name) as session:
            assert (session.sample, session.camera.make, session.camera.serial_number) == ("leaf 🍂", "Größe", "Ä1")


PROTOCOL = 'name = "p"\nbracket = {"exposure_times_s": [0.01], "darks": 0}\n'


def protocol(tmp_path: Path, text: str) -> Any:
    (tmp_path / "p.py").write_text(text, encoding="utf-8")
    return load_python_protocol(tmp_path / "p.py")


def test_numbers_of_numpy_are_numbers_in_a_protocol(tmp_path: Path) -> None:
    text = """
import numpy as np
name = "p"
bracket = {"exposure_times_s": np.array([0.01, 0.1]), "darks": np.int64(2)}
def poses():
    for turn in np.arange(3, dtype=np.float32):
        yield {"tilt": np.int32(5), "turn": turn}
"""
    read = protocol(tmp_path, text)
    assert read.bracket.exposure_times_s == (0.01, 0.1)
    assert read.bracket.darks == 2


def test_a_protocol_without_end_is_refused(tmp_path: Path) -> None:
    text = f"{PROTOCOL}def poses():\n    while True:\n        yield {{'tilt': 0.0}}\n"
    with pytest.raises(InvalidInputError, match=f"more than {MAX_POSES} poses, and may never end"):
        protocol(tmp_path, text)


@pytest.mark.parametrize("where", ["import sys\nsys.exit(0)\n", ""])
def test_a_protocol_that_ends_the_program_is_refused(tmp_path: Path, where: str) -> None:
    text = f"{where}{PROTOCOL}def poses():\n    raise SystemExit\n    yield\n"
    with pytest.raises(InvalidInputError, match="ends the program"):
        protocol(tmp_path, text)


def test_a_stack_of_another_major_version_is_refused(tmp_path: Path) -> None:
    write_stack(tmp_path / "a.stack.h5", make_stack(n_views=6, size=4))
    with h5py.File(tmp_path / "a.stack.h5", "r+") as file:
        file["entry"].attrs["halfangle_schema"] = "2.0"
    with pytest.raises(InvalidInputError, match=r"is 2\.0; this halfangle reads 1\.x"):
        read_stack(tmp_path / "a.stack.h5")


def test_a_result_without_a_solved_pixel_says_so_everywhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stack = make_stack(n_views=8, size=6)
    black = replace(stack, radiance=np.zeros_like(stack.radiance))
    write_stack(tmp_path / "a.stack.h5", black)
    arguments = ("--palette", "off", "--accuracy", "draft", "--left-out", "0", "-q")
    assert exit_code("reconstruct", tmp_path / "a.stack.h5", "-o", tmp_path / "a.result.h5", *arguments) == 3
    assert "NO PIXEL IS SOLVED" in capsys.readouterr().out
    assert exit_code("report", tmp_path / "a.result.h5", "-o", tmp_path / "a.html") == 0
    assert "NO PIXEL IS SOLVED" in (tmp_path / "a.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_the_unit_of_radiance_changes_no_normal(tmp_path: Path, unit: float) -> None:
    stack = make_stack(n_views=16, size=6)
    arguments = ("--palette", "off", "--accuracy", "draft", "--left-out", "0", "-q")
    normals = []
    for name, scale in (("one", 1.0), ("other", unit)):
        variance = None if stack.variance is None else (stack.variance * scale**2).astype(np.float32)
        scaled = replace(stack, radiance=(stack.radiance * scale).astype(np.float32), variance=variance)
        write_stack(tmp_path / f"{name}.stack.h5", scaled)
        exit_code("reconstruct", tmp_path / f"{name}.stack.h5", "-o", tmp_path / f"{name}.result.h5", *arguments)
        normals.append(read_result(tmp_path / f"{name}.result.h5").normals)
    solved = np.isfinite(normals[0])
    assert solved.any()
    # Radiances are kept in single precision; the stated sigma of these normals is 3e-3.
    np.testing.assert_allclose(normals[1][solved], normals[0][solved], atol=1e-3)
