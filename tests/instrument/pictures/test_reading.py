from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from instrument.pictures import exif
from instrument.pictures.exif import Shot, read_shot
from instrument.pictures.picture import UnreadablePictureError
from instrument.pictures.reading import read_picture
from tests.instrument.imports.folders import (
    H,
    W,
    mosaic,
    write_dng,
    write_exr,
    write_jpeg,
    write_png,
    write_tiff,
)

RGB8 = np.random.default_rng(0).integers(0, 256, (H, W, 3)).astype(np.uint8)
FLOATS = np.random.default_rng(1).uniform(0, 9, (H, W, 3)).astype(np.float32)


def test_a_dng_gives_its_counts_pattern_levels_and_exif(tmp_path: Path) -> None:
    path = write_dng(tmp_path / "a.dng", mosaic(0), 1 / 250)
    picture, shot = read_picture(path), read_shot(path)
    np.testing.assert_array_equal(picture.pixels, mosaic(0))
    assert (picture.bayer_pattern, picture.saturation_level) == ("RGGB", 4095)
    assert picture.black_level == (64, 65, 66, 67)
    assert (shot.exposure_time, shot.f_number, shot.iso) == (pytest.approx(0.004), 8.0, 100)
    assert (shot.make, shot.model) == ("acme", "pocket")


@pytest.mark.parametrize(("top", "left"), [(0, 0), (4, 2), (3, 2), (2, 5), (1, 1)])
def test_masked_borders_are_left_out_and_the_pattern_moves_with_them(tmp_path: Path, top: int, left: int) -> None:
    # The cell of a DNG begins at its active area: there each colour has counts of its own.
    counts = np.full((H, W), 1, np.uint16)
    for (i, j), count in {(0, 0): 1000, (0, 1): 2000, (1, 0): 2000, (1, 1): 3000}.items():
        counts[top + i :: 2, left + j :: 2] = count
    path = write_dng(tmp_path / "a.dng", counts, None, active_area=(top, left, H, W), black=(64,) * 4)
    picture = read_picture(path)
    # LibRaw leaves out up to one more row and column.
    assert picture.pixels.shape[0] in (H - top - 1, H - top)
    assert picture.pixels.shape[1] in (W - left - 1, W - left)
    expected = [{"R": 1000, "G": 2000, "B": 3000}[letter] for letter in picture.bayer_pattern or ""]
    for place, count in zip([(0, 0), (0, 1), (1, 0), (1, 1)], expected, strict=True):
        assert (picture.pixels[place[0] :: 2, place[1] :: 2] == count).all()


@pytest.mark.parametrize(("cell", "pattern"), [(b"\2\1\1\0", "BGGR"), (b"\1\0\2\1", "GRBG"), (b"\1\2\0\1", "GBRG")])
def test_every_bayer_pattern_is_known_and_black_levels_keep_their_places(
    tmp_path: Path, cell: bytes, pattern: str
) -> None:
    picture = read_picture(write_dng(tmp_path / "a.dng", mosaic(0), None, cell))
    assert picture.bayer_pattern == pattern
    assert picture.black_level == (64, 65, 66, 67)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float16])
@pytest.mark.parametrize("n_channels", [1, 3])
def test_tiff_is_read_as_it_is(tmp_path: Path, dtype: type, n_channels: int) -> None:
    pixels = (FLOATS if n_channels == 3 else FLOATS[..., 0]) * 25
    path = write_tiff(tmp_path / "a.tif", pixels.astype(dtype), 0.5)
    np.testing.assert_array_equal(read_picture(path).pixels, pixels.astype(dtype))
    assert read_shot(path).exposure_time == 0.5


def test_either_order_of_bytes_is_read(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", mosaic(0), byteorder=">")
    np.save(tmp_path / "a.npy", mosaic(0).astype(">u2"))
    for name in ("a.tif", "a.npy"):
        picture = read_picture(tmp_path / name)
        np.testing.assert_array_equal(picture.pixels, mosaic(0))
        assert picture.pixels.dtype == np.uint16


def test_tiff_with_planes_one_after_the_other_is_read_as_channels(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.moveaxis(RGB8, -1, 0), photometric="rgb", planarconfig="separate")
    np.testing.assert_array_equal(read_picture(tmp_path / "a.tif").pixels, RGB8)


def test_compressed_tiff_is_read(tmp_path: Path) -> None:
    Image.fromarray(RGB8).save(tmp_path / "a.tif", compression="tiff_lzw")
    np.testing.assert_array_equal(read_picture(tmp_path / "a.tif").pixels, RGB8)


@pytest.mark.parametrize("pixels", [RGB8, RGB8[..., 0], mosaic(0), RGB8.astype(np.uint16) * 200])
def test_png_is_read_as_it_is(tmp_path: Path, pixels: np.ndarray) -> None:
    np.testing.assert_array_equal(read_picture(write_png(tmp_path / "a.png", pixels)).pixels, pixels)


def test_jpeg_gives_red_green_blue_unrotated_with_exif(tmp_path: Path) -> None:
    even = np.full((H, W, 3), (200, 100, 20), np.uint8)
    path = write_jpeg(tmp_path / "a.jpg", even, 1 / 8, iso=400)
    with Image.open(path) as image:
        exif = image.getexif()
        exif[274] = 6
        image.save(tmp_path / "turned.jpg", exif=exif, quality=95)
    pixels = read_picture(tmp_path / "turned.jpg").pixels
    assert pixels.shape == (H, W, 3)
    np.testing.assert_allclose(pixels, even, atol=3)
    assert read_shot(tmp_path / "turned.jpg") == Shot(
        exposure_time=0.125, iso=400, f_number=8.0, white_balance="Manual"
    )


@pytest.mark.parametrize("pixels", [FLOATS, FLOATS[..., 0]])
def test_exr_is_read_as_it_is(tmp_path: Path, pixels: np.ndarray) -> None:
    path = write_exr(tmp_path / "a.exr", pixels, 0.25)
    np.testing.assert_array_equal(read_picture(path).pixels, pixels)
    assert read_shot(path).exposure_time == 0.25


def test_numpy_is_read_as_it_is_in_single_precision(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", FLOATS.astype(np.float64))
    picture = read_picture(tmp_path / "a.npy")
    np.testing.assert_array_equal(picture.pixels, FLOATS)
    assert picture.pixels.dtype == np.float32


def written(folder: Path) -> list[Path]:
    return [
        write_dng(folder / "a.dng", mosaic(0), None),
        write_tiff(folder / "a.tif", mosaic(0), None),
        write_png(folder / "a.png", mosaic(0)),
        write_jpeg(folder / "a.jpg", RGB8, None),
        write_exr(folder / "a.exr", FLOATS),
    ]


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_every_file_that_is_cut_short_is_refused(tmp_path: Path, share: float) -> None:
    for path in written(tmp_path):
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])
        with pytest.raises(UnreadablePictureError, match=r"cannot be read|damaged|no picture"):
            read_picture(path)


def test_a_damaged_header_is_silence_and_no_crash(tmp_path: Path) -> None:
    for path in written(tmp_path):
        content = bytearray(path.read_bytes())
        content[4:200] = bytes(196)
        path.write_bytes(content)
        assert read_shot(path).exposure_time is None


def test_libraw_tells_what_exif_of_a_raw_file_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_dng(tmp_path / "a.dng", mosaic(0), 1 / 250)
    monkeypatch.setattr(exif.exifread, "process_file", lambda file, details: {})
    shot = read_shot(path)
    assert (shot.exposure_time, shot.f_number) == (0.004, 8.0)


def test_files_of_other_kinds_say_what_is_needed(tmp_path: Path) -> None:
    cases = {
        "two.npy": (np.zeros((H, W, 2), np.float32), "has shape"),
        "long.npy": (np.zeros((H, W), np.int64), "has values of type int64"),
        "hole.npy": (np.full((H, W), np.nan, np.float32), "NaN or infinite"),
        "none.npy": (np.zeros((0, W), np.uint8), "has shape"),
    }
    for name, (values, expected) in cases.items():
        np.save(tmp_path / name, values)
        with pytest.raises(UnreadablePictureError, match=expected):
            read_picture(tmp_path / name)
    tifffile.imwrite(tmp_path / "many.tif", np.zeros((5, H, W), np.uint16), photometric="minisblack")
    with pytest.raises(UnreadablePictureError, match="holds 5 pictures"):
        read_picture(tmp_path / "many.tif")
    Image.fromarray(RGB8).convert("CMYK").save(tmp_path / "print.jpg")
    with pytest.raises(UnreadablePictureError, match="CMYK"):
        read_picture(tmp_path / "print.jpg")
