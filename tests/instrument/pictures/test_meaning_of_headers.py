"""What a header says of the values is heeded, or the file is refused: found by files with random headers."""

from __future__ import annotations

from pathlib import Path
from struct import pack
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from instrument.imports.template import capture_template
from instrument.pictures.picture import UnreadablePictureError
from instrument.pictures.reading import read_picture
from instrument.pictures.stated_curve import curve_of_profile
from tests.instrument.imports.folders import H, W, imported, mosaic, refused, write_dng
from tests.instrument.pictures.made.made import icc_profile
from tests.instrument.pictures.made.png import chunk
from tests.instrument.pictures.writers import compressed_tiff

RGB8 = np.random.default_rng(0).integers(0, 256, (H, W, 3)).astype(np.uint8)
GREY16 = np.random.default_rng(1).integers(0, 65536, (H, W)).astype(np.uint16)
LIGHT = np.random.default_rng(2).uniform(0.1, 9.0, (H, W, 3)).astype(np.float32)
ONE_EXPOSURE = "[grouping]\nexposure_times_s = [1.0]\n"


def refusal(path: Path) -> str:
    with pytest.raises(UnreadablePictureError) as caught:
        read_picture(path)
    return str(caught.value)


@pytest.mark.parametrize(("top", "left"), [(1, 1), (0, 1), (3, 0), (2, 4)])
def test_black_levels_stay_with_their_pixels_where_a_row_more_is_left_out(tmp_path: Path, top: int, left: int) -> None:
    black = np.array([[10, 20], [30, 40]])
    counts = np.zeros((H, W), np.uint16)
    for (i, j), level in np.ndenumerate(black):
        counts[top + i :: 2, left + j :: 2] = 100 + level
    area = (top, left, H, W)
    picture = read_picture(write_dng(tmp_path / "a.dng", counts, None, black=(10, 20, 30, 40), active_area=area))
    rows, columns = np.indices(picture.pixels.shape)
    assert picture.black_level is not None
    np.testing.assert_array_equal(picture.pixels - np.reshape(picture.black_level, (2, 2))[rows % 2, columns % 2], 100)


def dng(path: Path, *tags: tuple[Any, ...], pixels: NDArray[Any] | None = None, photometric: int = 32803) -> Path:
    cell = [(33421, "H", 2, (2, 2), True), (33422, "B", 4, b"\0\1\1\2", True), (50706, "B", 4, b"\1\4\0\0", True)]
    area = (50829, "I", 4, (0, 0, H, W), True)
    pixels = mosaic(0) if pixels is None else pixels
    tifffile.imwrite(path, pixels, photometric=photometric, extratags=[*cell, area, *tags], metadata=None)
    return path


def test_black_levels_that_are_no_whole_numbers_are_kept(tmp_path: Path) -> None:
    levels = (50714, "2I", 4, (642, 10, 653, 10, 657, 10, 66, 1), True)
    path = dng(tmp_path / "a.dng", (50713, "H", 2, (2, 2), True), levels)
    assert read_picture(path).black_level == (64.2, 65.3, 65.7, 66.0)


def opcodes(number: int) -> tuple[Any, ...]:
    content = pack(">IIIII", 1, number, 0x01030000, 1, 4) + bytes(4)
    return (51009, "B", len(content), content, True)


@pytest.mark.parametrize(
    ("tag", "told"),
    [
        ((50715, "2i", W, (1, 1) * W, True), "black levels of its own for rows or columns; save it without"),
        ((50716, "2i", H, (1, 1) * H, True), "black levels of its own for rows or columns"),
        ((50714, "I", 3, (1, 2, 3), True), "has 3 black levels for a pattern of 1 x 1; state each"),
        ((50711, "H", 1, 2, True), "a mosaic in staggered rows or columns"),
        (opcodes(8), r"asks for its values to be mapped \(MapPolynomial\); save it with that done"),
        ((274, "H", 1, 2, True), r"stored mirrored \(orientation 2\); save it upright"),
    ],
)
def test_a_dng_that_asks_for_what_is_not_done_is_refused(tmp_path: Path, tag: tuple[Any, ...], told: str) -> None:
    with pytest.raises(UnreadablePictureError, match=told):
        read_picture(dng(tmp_path / "a.dng", tag))


def test_a_dng_with_a_sign_is_refused_and_one_that_corrects_its_lens_is_read(tmp_path: Path) -> None:
    assert "whole numbers with a sign" in refusal(dng(tmp_path / "a.dng", pixels=mosaic(0).astype(np.int16)))
    no_deltas = (50715, "2i", W, (0, 1) * W, True)
    np.testing.assert_array_equal(read_picture(dng(tmp_path / "b.dng", opcodes(9), no_deltas)).pixels, mosaic(0))


def test_the_table_of_a_dng_is_applied(tmp_path: Path) -> None:
    table = np.arange(4096) ** 2 // 4096
    path = dng(tmp_path / "a.dng", (50712, "H", 4096, tuple(table.tolist()), True))
    np.testing.assert_array_equal(read_picture(path).pixels, table[mosaic(0)])


def test_a_dng_in_all_but_its_name_is_read_as_one(tmp_path: Path) -> None:
    black = (50714, "I", 1, 64, True)
    picture = read_picture(dng(tmp_path / "a.tif", black))
    assert (picture.bayer_pattern, picture.black_level) == ("RGGB", (64,) * 4)
    tifffile.imwrite(tmp_path / "b.tif", GREY16, photometric=32803)
    assert "does not say of which colours its mosaic is; state CFAPattern" in refusal(tmp_path / "b.tif")


@pytest.mark.parametrize("orientation", [2, 4, 5, 7])
def test_mirrored_pictures_are_refused(tmp_path: Path, orientation: int) -> None:
    exif = Image.Exif()
    exif[274] = orientation
    for name in ("a.jpg", "a.png"):
        Image.fromarray(RGB8).save(tmp_path / name, exif=exif)
    tifffile.imwrite(tmp_path / "a.tif", RGB8, extratags=[(274, "H", 1, orientation, True)])
    for name in ("a.jpg", "a.png", "a.tif"):
        assert f"stored mirrored (orientation {orientation}); save it upright" in refusal(tmp_path / name)


def test_compressed_tiffs_that_one_library_turns_or_does_not_fill_are_refused(tmp_path: Path) -> None:
    compressed_tiff(tmp_path / "a.tif", RGB8, "lzw", more=[(274, "H", [3])])
    assert "is compressed and to be turned when it is shown; save it uncompressed" in refusal(tmp_path / "a.tif")
    for values in (LIGHT, LIGHT.astype(np.float16)):
        compressed_tiff(tmp_path / "b.tif", values, "lzw", planar=True)
        assert "is compressed in a way that cannot be read; save it uncompressed" in refusal(tmp_path / "b.tif")
    compressed_tiff(tmp_path / "c.tif", LIGHT, "lzw")
    np.testing.assert_array_equal(read_picture(tmp_path / "c.tif").pixels, LIGHT)


def test_tiffs_that_hold_more_or_other_than_their_page_says_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.stack([GREY16] * 3), photometric="minisblack", truncate=True)
    assert "holds 3 pictures" in refusal(path)
    tifffile.imwrite(path, GREY16, subfiletype=1)
    assert "begins with a reduced copy of its picture" in refusal(path)
    text = "ImageJ=1.11a\nimages=1\ncf=0\nc0=-32768.0\nc1=1.0\nvunit=Gray Value\n"
    tifffile.imwrite(path, GREY16, description=text, metadata=None)
    assert "states a calibration of its values (ImageJ); save it without" in refusal(path)


def png_with(path: Path, *chunks: tuple[bytes, bytes], mode: str = "I;16") -> Path:
    Image.fromarray(GREY16 if mode == "I;16" else RGB8).save(path)
    content = path.read_bytes()
    # After the first part, which has 25 bytes and stands behind 8 of a signature.
    path.write_bytes(content[:33] + b"".join(chunk(name, data) for name, data in chunks) + content[33:])
    return path


def test_a_transparent_grey_and_a_moving_picture_are_refused(tmp_path: Path) -> None:
    path = png_with(tmp_path / "a.png", (b"tRNS", b"\0\1"))
    assert "transparent where it has one of its greys; flatten it" in refusal(path)
    frames = [Image.fromarray(RGB8), Image.fromarray(255 - RGB8)]
    frames[0].save(tmp_path / "b.png", save_all=True, append_images=frames[1:])
    assert "moves: it holds several pictures" in refusal(tmp_path / "b.png")


@pytest.mark.parametrize(
    ("name", "data", "told"),
    [
        (b"gAMA", pack(">I", 45_455), "a gamma of 0.45455"),
        (b"gAMA", pack(">I", 100_000), ""),
        (b"sRGB", b"\0", "the curve of sRGB"),
        (b"cICP", b"\1\x0d\0\1", "a transfer function (cICP)"),
        (b"cICP", b"\1\x08\0\1", ""),
    ],
)
def test_a_png_of_16_bits_that_states_a_curve_needs_a_word(tmp_path: Path, name: bytes, data: bytes, told: str) -> None:
    png_with(tmp_path / "a.png", (name, data))
    assert read_picture(tmp_path / "a.png").curve == told
    if not told:
        imported(tmp_path, f'name = "a"\n{ONE_EXPOSURE}').close()
        return
    message = refused(tmp_path, f'name = "a"\n{ONE_EXPOSURE}')
    assert f"a.png: states {told}, so that its values are not proportional to light; add [response]" in message
    assert "If they are proportional to light, set linear = true" in message
    assert f"# The pictures state {told}. Say by which curve" in capture_template(tmp_path)
    for word in ("linear = true\n", '[response]\ngamma = "srgb"\n'):
        (tmp_path / "s.h5").unlink(missing_ok=True)
        imported(tmp_path, f'name = "a"\n{word}{ONE_EXPOSURE}').close()


def test_profiles_are_linear_only_where_every_curve_is_straight() -> None:
    assert curve_of_profile(icc_profile(1.0)) == ""
    for profile in (icc_profile(2.2), icc_profile(1.0)[:190], b"", bytes(200)):
        assert curve_of_profile(profile) == "a colour profile with a curve"


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_a_tiff_that_states_a_curve_needs_a_word(tmp_path: Path, dtype: Any) -> None:
    tifffile.imwrite(tmp_path / "a.tif", GREY16.astype(dtype), iccprofile=icc_profile(2.2))
    message = refused(tmp_path, f'name = "a"\n{ONE_EXPOSURE}')
    assert "a.tif: states a colour profile with a curve, so that its values are not proportional to light" in message
    assert ("; undo it." if dtype is np.float32 else "; add [response]") in message
    imported(tmp_path, f'name = "a"\nlinear = true\n{ONE_EXPOSURE}').close()


def test_other_ways_of_a_tiff_to_state_a_curve_are_known(tmp_path: Path) -> None:
    path, ramp = tmp_path / "a.tif", np.arange(65536)
    for table, told in ((ramp, ""), (ramp**2 // 65535, "a transfer function")):
        tifffile.imwrite(path, GREY16, extratags=[(301, "H", 65536, tuple(table.tolist()), True)])
        assert read_picture(path).curve == told
    size = 0
    for _ in range(2):
        compressed_tiff(path, GREY16[..., None], "none", more=[(34665, "I", [size])])
        size = path.stat().st_size
    with path.open("ab") as end:
        end.write(pack("<HHHIII", 1, 0xA001, 3, 1, 1, 0))  # one entry, ColorSpace, and it says 1
    assert read_picture(path).curve == "the curve of sRGB"


def exr(path: Path, channels: dict[str, NDArray[Any]], **header: Any) -> Path:
    with OpenEXR.File({"type": OpenEXR.scanlineimage} | header, channels) as file:
        file.write(str(path))
    return path


def test_an_exr_that_is_more_or_less_than_its_channels_is_refused(tmp_path: Path) -> None:
    grey = np.ascontiguousarray(LIGHT[..., 0])
    path, hole = tmp_path / "a.exr", np.ones_like(grey)
    hole[3, 4] = 0.5
    shown = ((0, 0), (W + 3, H + 3))
    for channels, header, told in (
        ({"Y": grey, "A": hole}, {}, "transparent in places"),
        ({"Y": grey, "RY": grey, "BY": grey}, {}, "has colours as Y, RY and BY; save it as R, G and B"),
        ({"Y": grey}, {"dataWindow": ((2, 2), (W + 1, H + 1)), "displayWindow": shown}, "a data window that is not"),
    ):
        assert told in refusal(exr(path, channels, **header))
    np.testing.assert_array_equal(read_picture(exr(path, {"Y": grey, "A": np.ones_like(grey)})).pixels, grey)


def test_of_an_exr_of_several_parts_the_one_that_is_a_picture_is_read(tmp_path: Path) -> None:
    path, header = tmp_path / "a.exr", {"type": OpenEXR.scanlineimage}
    depth = OpenEXR.Part(header | {"name": "depth"}, {"Z": np.ascontiguousarray(LIGHT[..., 0])})
    left, right = (OpenEXR.Part(header | {"name": name}, {"RGB": LIGHT}) for name in ("left", "right"))
    with OpenEXR.File([depth, left]) as file:
        file.write(str(path))
    np.testing.assert_array_equal(read_picture(path).pixels, LIGHT)
    with OpenEXR.File([left, right]) as file:
        file.write(str(path))
    assert "holds 2 pictures; save each in a file of its own" in refusal(path)


@pytest.mark.parametrize("unit", [1e-40, 1e40])
def test_values_that_single_precision_does_not_hold_are_refused(tmp_path: Path, unit: float) -> None:
    np.save(tmp_path / "a.npy", LIGHT.astype(np.float64) * unit)
    assert "out of single precision; use another unit" in refusal(tmp_path / "a.npy")


def test_a_curve_that_some_of_the_pictures_state_is_named(tmp_path: Path) -> None:
    for name, profile in (("a.tif", None), ("b.tif", None), ("c.tif", icc_profile(2.2))):
        tifffile.imwrite(tmp_path / name, GREY16, iccprofile=profile)
    message = refused(tmp_path, f'name = "a"\nlinear = true\n{ONE_EXPOSURE}glob = "*.tif"\n')
    assert "c.tif: its stated curve is a colour profile with a curve and that of other pictures none" in message
    flats = '[flats]\nfiles = ["c.tif"]\nexposure_times_s = [1.0]\n'
    message = refused(tmp_path, f'name = "a"\n{ONE_EXPOSURE}glob = "*.tif"\n{flats}')
    assert "c.tif: states a colour profile with a curve, so that its values are not proportional" in message
