"""Kinds of files that programs for high dynamic range, Windows and phones write."""

from __future__ import annotations

import sys
from pathlib import Path
from struct import pack
from typing import Any

import cv2
import numpy as np
import pillow_heif
import pytest
import tifffile
from click.testing import CliRunner
from numpy.typing import NDArray
from PIL import Image

from analysis.registration.registered_pictures import import_registered
from cli.importing import import_pictures
from instrument.files.validation import InvalidInputError
from instrument.imports.template import capture_template
from instrument.pictures.exif import read_shot
from instrument.pictures.picture import UnreadablePictureError
from instrument.pictures.reading import LINEAR_SUFFIXES, READERS, read_picture
from tests.instrument.imports.folders import H, W, imported, mosaic, refused, write_jpeg
from tests.instrument.pictures.writers import packed_tiff, write_bmp, write_hdr, write_pfm

LIGHT = np.random.default_rng(0).uniform(0.01, 9.0, (H, W, 3)).astype(np.float32)
RGB8 = np.random.default_rng(1).integers(0, 256, (H, W, 3)).astype(np.uint8)

# A mantissa has 8 bits, of which the largest of three uses at least 7.
HDR_STEP = LIGHT.max(axis=2, keepdims=True) / 128


def assert_light(path: Path, light: NDArray[Any] = LIGHT) -> None:
    pixels = read_picture(path).pixels
    assert pixels.shape == light.shape
    assert (np.abs(pixels - light) <= HDR_STEP).all()


@pytest.mark.parametrize("how", ["runs", "old runs", "flat"])
def test_a_radiance_picture_gives_the_radiance(tmp_path: Path, how: str) -> None:
    write_hdr(tmp_path / "a.hdr", LIGHT, how=how)
    assert_light(tmp_path / "a.hdr")


def test_a_radiance_picture_of_opencv_is_read(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.hdr"), LIGHT[..., ::-1])
    assert_light(tmp_path / "a.hdr")


def test_long_runs_of_a_radiance_picture_are_read(tmp_path: Path) -> None:
    light = np.zeros((4, 600, 3), np.float32)
    light[:, 100:500] = 0.5
    for how in ("runs", "old runs"):
        write_hdr(tmp_path / "a.hdr", light, how=how)
        np.testing.assert_allclose(read_picture(tmp_path / "a.hdr").pixels, light, atol=0.5 / 128)


def test_exposures_and_colour_corrections_of_a_radiance_picture_are_undone(tmp_path: Path) -> None:
    lines = ["EXPOSURE=2.5", "EXPOSURE=4", "COLORCORR=1 2 0.5"]
    write_hdr(tmp_path / "a.hdr", LIGHT * np.float32([10, 20, 5]), lines)
    pixels = read_picture(tmp_path / "a.hdr").pixels
    step = (LIGHT * [10, 20, 5]).max(axis=2, keepdims=True) / 128 / [10, 20, 5]
    assert (np.abs(pixels - LIGHT) <= step).all()


@pytest.mark.parametrize("size", ["-Y +X", "+Y +X", "-Y -X", "+Y -X", "+X -Y", "+X +Y", "-X -Y", "-X +Y"])
def test_a_radiance_picture_stands_upright_however_its_lines_run(tmp_path: Path, size: str) -> None:
    write_hdr(tmp_path / "a.hdr", LIGHT, size=size)
    assert_light(tmp_path / "a.hdr")


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["FORMAT=32-bit_rle_xyze"], "format 32-bit_rle_xyze; save it as 32-bit_rle_rgbe"),
        (["GAMMA=2.2"], r"states GAMMA=2\.2; save it with linear values"),
        (["EXPOSURE=bright"], "states EXPOSURE=bright; needed are positive numbers"),
        (["EXPOSURE=0"], "states EXPOSURE=0"),
    ],
)
def test_a_radiance_picture_of_other_values_is_refused(tmp_path: Path, lines: list[str], told: str) -> None:
    write_hdr(tmp_path / "a.hdr", LIGHT, lines)
    with pytest.raises(UnreadablePictureError, match=told):
        read_picture(tmp_path / "a.hdr")


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("light", [LIGHT, LIGHT[..., 0]])
def test_a_portable_float_map_is_read_from_its_bottom_row(tmp_path: Path, order: str, light: NDArray[Any]) -> None:
    write_pfm(tmp_path / "a.pfm", light, order)
    np.testing.assert_array_equal(read_picture(tmp_path / "a.pfm").pixels, light)


def test_a_portable_float_map_of_opencv_is_read(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.pfm"), LIGHT[..., ::-1])
    np.testing.assert_array_equal(read_picture(tmp_path / "a.pfm").pixels, LIGHT)


def test_a_scale_that_some_programs_multiply_by_and_others_divide_by_is_refused(tmp_path: Path) -> None:
    write_pfm(tmp_path / "a.pfm", LIGHT, "<", scale=0.5)
    with pytest.raises(UnreadablePictureError, match=r"states the scale -0\.5.*save it with 1 or -1"):
        read_picture(tmp_path / "a.pfm")


@pytest.mark.parametrize("mode", ["RGB", "L", "P", "1"])
def test_a_bitmap_is_read_as_it_is(tmp_path: Path, mode: str) -> None:
    image = Image.fromarray(RGB8[..., 0]) if mode in "L1" else Image.fromarray(RGB8)
    image.convert(mode).save(tmp_path / "a.bmp")
    shown = np.asarray(image.convert(mode).convert("L" if mode in "L1" else "RGB"))
    np.testing.assert_array_equal(read_picture(tmp_path / "a.bmp").pixels, shown)


def test_a_bitmap_from_the_top_and_one_of_four_bytes_a_pixel_are_read(tmp_path: Path) -> None:
    for fourth in (0, 255):
        write_bmp(tmp_path / "a.bmp", RGB8, bits=32, fourth=fourth, from_top=fourth == 0)
        np.testing.assert_array_equal(read_picture(tmp_path / "a.bmp").pixels, RGB8)


def test_bitmaps_of_other_kinds_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.bmp"
    for options, told in (
        ({"bits": 16}, "has 16 bits for all colours of a pixel; save it with 24, or as PNG"),
        ({"bits": 32, "fourth": 100}, "is transparent in places"),
        ({"bits": 32, "masks": (0xFF, 0xFF00, 0xFF0000)}, "in another order; save it as PNG"),
        ({"bits": 8, "compression": 1}, r"is compressed \(RLE8\); save it uncompressed"),
    ):
        write_bmp(path, RGB8, **options)
        with pytest.raises(UnreadablePictureError, match=told):
            read_picture(path)


def write_heic(path: Path, orientation: int = 1, time: float = 0.125) -> None:
    exif = Image.Exif()
    exif[274] = orientation
    exif.get_ifd(0x8769)[33434] = time
    file = pillow_heif.from_pillow(Image.fromarray(RGB8))
    file.save(path, quality=-1, chroma=444, matrix_coefficients=0, exif=exif.tobytes())


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_a_heic_gives_red_green_blue_unrotated_with_exif(tmp_path: Path, orientation: int) -> None:
    write_heic(tmp_path / "a.heic", orientation)
    picture = read_picture(tmp_path / "a.heic")
    np.testing.assert_allclose(picture.pixels, RGB8, atol=1)
    assert picture.orientation == orientation
    assert read_shot(tmp_path / "a.heic").exposure_time == 0.125


def test_a_heic_of_ten_bits_and_a_mirrored_one_are_refused(tmp_path: Path) -> None:
    deep = pillow_heif.from_bytes("RGB;16", (W, H), (RGB8.astype(np.uint16) << 8).tobytes())
    deep.save(tmp_path / "deep.heic", quality=-1)
    write_heic(tmp_path / "mirrored.heic", 2)
    for name, told in (("deep.heic", "has 10 bits and a curve"), ("mirrored.heic", "stored mirrored")):
        with pytest.raises(UnreadablePictureError, match=told):
            read_picture(tmp_path / name)


def test_heic_pictures_need_a_word_about_their_curve(tmp_path: Path) -> None:
    write_heic(tmp_path / "a.heic")
    assert "pictures of 8 bits are made for display" in refused(tmp_path, 'name = "a"\n')
    with imported(tmp_path, 'name = "a"\n[response]\ngamma = "srgb"\n') as session:
        assert (session.camera.bit_depth, session.camera.n_channels) == (8, 3)


@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("n_channels", [1, 3])
def test_a_tiff_of_packed_values_is_unpacked(tmp_path: Path, bits: int, n_channels: int) -> None:
    counts = np.stack([mosaic(i, bits)[:, :-1] for i in range(n_channels)], axis=-1)
    packed_tiff(tmp_path / "a.tif", counts, bits)
    picture = read_picture(tmp_path / "a.tif")
    np.testing.assert_array_equal(picture.pixels, counts[..., 0] if n_channels == 1 else counts)
    assert picture.saturation_level == 2**bits - 1


def test_a_session_of_packed_values_clips_where_their_bits_end(tmp_path: Path) -> None:
    packed_tiff(tmp_path / "a.tif", (mosaic(0, 12) >> 3)[..., None], 12)
    with imported(tmp_path, 'name = "a"\n[grouping]\nexposure_times_s = [1.0]\n') as session:
        assert (session.camera.bit_depth, session.camera.saturation_value) == (12, 4095)


POSITIONS = "file,camera_x_mm,camera_y_mm,camera_z_mm\n"


def registered(folder: Path, names: list[str], gamma: float | None = None) -> Any:
    rows = "".join(f"{name},{i},0,300\n" for i, name in enumerate(names))
    (folder / "p.csv").write_text(POSITIONS + rows)
    return import_registered(folder, folder / "p.csv", 20.0, gamma, 1)


def test_registered_packed_values_clip_where_their_bits_end(tmp_path: Path) -> None:
    packed_tiff(tmp_path / "a.tif", mosaic(0, 12)[..., None], 12)
    stack = registered(tmp_path, ["a.tif"], 1.0)
    np.testing.assert_allclose(stack.radiance[0, ..., 0], mosaic(0, 12) / 4095, rtol=1e-6)
    np.testing.assert_array_equal(stack.saturated[0, ..., 0] > 0, mosaic(0, 12) == 4095)


@pytest.mark.parametrize("suffix", [".hdr", ".pfm"])
def test_kinds_of_floating_point_numbers_are_linear_and_clip_nowhere(tmp_path: Path, suffix: str) -> None:
    write = write_hdr if suffix == ".hdr" else write_pfm
    np.save(tmp_path / "b.npy", LIGHT)
    write(tmp_path / f"a{suffix}", LIGHT)
    one, other = (registered(tmp_path, [name]) for name in (f"a{suffix}", "b.npy"))
    np.testing.assert_allclose(one.radiance, other.radiance, atol=HDR_STEP.max())
    np.testing.assert_allclose(one.variance, other.variance, rtol=0.1, atol=1e-3)
    assert not one.saturated.any()
    with imported(tmp_path, f'name = "a"\n[grouping]\nglob = "*{suffix}"\nexposure_times_s = [1.0]\n') as session:
        assert session.camera.dtype == "f4"
        assert np.isinf(session.camera.saturation_value)


def test_registered_pictures_that_are_to_be_turned_are_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", RGB8, extratags=[(274, "H", 1, 6, True)])
    with pytest.raises(InvalidInputError, match=r"to be turned when it is shown \(orientation 6\); save it upright"):
        registered(tmp_path, ["a.tif"], 1.0)


def test_every_file_of_these_kinds_that_is_cut_short_is_refused(tmp_path: Path) -> None:
    write_hdr(tmp_path / "a.hdr", LIGHT)
    write_hdr(tmp_path / "flat.hdr", LIGHT, how="flat")
    write_pfm(tmp_path / "a.pfm", LIGHT)
    write_bmp(tmp_path / "a.bmp", RGB8)
    write_heic(tmp_path / "a.heic")
    packed_tiff(tmp_path / "a.tif", mosaic(0, 12)[..., None], 12)
    for path in list(tmp_path.iterdir()):
        content = path.read_bytes()
        for share in (0.0, 0.01, 0.1, 0.5, 0.9, 0.99):
            path.write_bytes(content[: int(share * len(content))])
            with pytest.raises(UnreadablePictureError):
                read_picture(path)


def test_kinds_that_nobody_reads_are_refused_with_those_that_are_known(tmp_path: Path) -> None:
    Image.fromarray(RGB8).save(tmp_path / "a.webp")
    for told in (
        refused(tmp_path, 'name = "a"\n'),
        refused(tmp_path, 'name = "a"\n[[poses]]\nfiles = ["a.webp"]\n'),
    ):
        assert all(suffix in told for suffix in READERS)
    with pytest.raises(InvalidInputError, match=r"holds no picture; known are RAW files of cameras \(\.dng"):
        capture_template(tmp_path)


@pytest.mark.parametrize("name", ["a.mp4", "B.MOV"])
def test_a_video_is_refused_with_the_way_to_pictures_of_it(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"\0\0\0\x18ftypmp42")
    told = refused(tmp_path, f'name = "a"\n[[poses]]\nfiles = ["{name}"]\nexposure_times_s = [0.1]\n')
    assert f"{name}: is a video; make pictures of it: ffmpeg -i VIDEO" in told
    with pytest.raises(InvalidInputError, match="is a video; make pictures of it"):
        capture_template(tmp_path)
    told = CliRunner().invoke(import_pictures, [str(tmp_path / name), "-o", "a.h5"])
    assert told.exit_code == 2
    assert "is a video; make pictures of it: ffmpeg -i VIDEO" in told.output
    write_jpeg(tmp_path / "frame.jpg", RGB8, 0.1)
    assert 'glob = "*.jpg"' in capture_template(tmp_path)


def test_all_that_is_linear_is_known() -> None:
    assert set(LINEAR_SUFFIXES) < set(READERS)


def test_a_bitmap_without_a_beginning_is_none(tmp_path: Path) -> None:
    (tmp_path / "a.bmp").write_bytes(b"PM" + pack("<I", 0) * 20)
    with pytest.raises(UnreadablePictureError, match="is no bitmap"):
        read_picture(tmp_path / "a.bmp")


def test_where_the_package_for_heic_is_missing_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_heic(tmp_path / "a.heic", 1)
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(UnreadablePictureError, match=r"needs the extra halfangle\[heif\]; or save it as JPEG"):
        read_picture(tmp_path / "a.heic")
