"""Files with random, valid headers: the same light, or a refusal by name, never another number and never a crash.

``HALFANGLE_SEED=7 make soak`` begins at another seed than 0; a failure shows the seed and header of its file.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from instrument.pictures.picture import Picture, UnreadablePictureError
from instrument.pictures.reading import read_picture
from tests.instrument.pictures.made.dng import make_dng
from tests.instrument.pictures.made.exr import make_exr
from tests.instrument.pictures.made.made import Array, Chooser, Made
from tests.instrument.pictures.made.plain import make_bmp, make_hdr, make_npy, make_pfm
from tests.instrument.pictures.made.png import make_png
from tests.instrument.pictures.made.tiff import make_tiff

FIRST_SEED = int(os.environ.get("HALFANGLE_SEED", "0"))
SHARES: dict[Callable[[Path, Chooser], Made], float] = {
    make_tiff: 0.4,
    make_dng: 0.2,
    make_exr: 0.12,
    make_png: 0.14,
    make_npy: 0.05,
    make_hdr: 0.04,
    make_bmp: 0.03,
    make_pfm: 0.02,
}
MIRRORED = (2, 4, 5, 7)


def made(folder: Path, seed: int) -> Made:
    choose = Chooser(np.random.default_rng(seed))
    maker = choose.rng.choice(np.array(list(SHARES), object), p=list(SHARES.values()))
    path = folder / f"{seed}.x"
    found: Made = maker(path, choose)
    return found


def wrong(made: Made) -> str:
    """Return what is wrong with how a file is read; "" = nothing, "refused" = it may be refused and is."""
    try:
        picture = read_picture(made.path)
    except UnreadablePictureError as error:
        return f"is refused: {error}" if made.must_read else "refused"
    if made.light is None or made.header.get("orientation") in MIRRORED:
        return "is read, and cannot be"
    if bool(picture.curve) != made.curve:
        return f"says of its curve: {picture.curve!r}"
    if made.white is not None and picture.saturation_level != made.white:
        return f"clips at {picture.saturation_level}, not {made.white}"
    return difference(made, picture)


def difference(made: Made, picture: Picture) -> str:
    assert made.light is not None
    light = made.light if made.light.ndim == 3 else made.light[..., None]
    pixels = picture.pixels if picture.pixels.ndim == 3 else picture.pixels[..., None]
    if made.black is not None:
        return mosaic_difference(made, light, picture)
    if pixels.shape[:2] != light.shape[:2] or pixels.shape[2] not in (light.shape[2], 3):
        return f"has the shape {pixels.shape}, not {light.shape}"
    off = np.abs(pixels.astype(np.float64) - light)
    return "" if (off <= made.step).all() else f"is off by up to {off.max():g}"


def mosaic_difference(made: Made, light: Array, picture: Picture) -> str:
    """Compare what is above the black level; LibRaw may leave out a row and a column more at the top and left."""
    assert made.black is not None
    pixels = picture.pixels if picture.pixels.ndim == 3 else picture.pixels[..., None]
    dy, dx = light.shape[0] - pixels.shape[0], light.shape[1] - pixels.shape[1]
    if dy not in (0, 1) or dx not in (0, 1) or pixels.shape[2] != light.shape[2]:
        return f"has the shape {pixels.shape}, not {light.shape}"
    rows, columns = np.indices(light.shape[:2])
    meant = light - made.black[rows % 2, columns % 2][..., None]
    rows, columns = np.indices(pixels.shape[:2])
    black = np.reshape(picture.black_level, (2, 2))
    read = pixels - black[rows % 2, columns % 2][..., None]
    off = np.abs(read - meant[dy:, dx:])
    pattern = (
        "".join((made.pattern or "")[2 * ((i + dy) % 2) + (j + dx) % 2] for i in (0, 1) for j in (0, 1))
        if made.pattern
        else ""
    )
    if picture.bayer_pattern != pattern:
        return f"has the pattern {picture.bayer_pattern}, not {pattern}"
    return "" if (off <= made.step).all() else f"is off by up to {off.max():g}"


def campaign(folder: Path, seeds: range) -> Iterator[tuple[Made, str]]:
    """Read a file of each seed; yield it with what became of it."""
    told = []
    for seed in seeds:
        file = made(folder, seed)
        outcome = wrong(file)
        if outcome not in ("", "refused"):
            told.append(f"seed {seed}: {file.path.name} {outcome}\n    {file.header}")
        yield file, outcome
        file.path.unlink()
    assert not told, "\n".join([f"{len(told)} of {len(seeds)} files:", *told[:40]])


def read_all(folder: Path, seeds: range) -> Counter[str]:
    return Counter(f"{file.path.suffix} {outcome or 'read'}" for file, outcome in campaign(folder, seeds))


def test_hundreds_of_files_give_their_light_or_are_refused(tmp_path: Path) -> None:
    found = read_all(tmp_path, range(300))
    for suffix in (".tif", ".dng", ".exr", ".png", ".npy", ".hdr", ".bmp", ".pfm"):
        assert found[f"{suffix} read"]


@pytest.mark.slow
def test_thousands_of_files_give_their_light_or_are_refused(tmp_path: Path) -> None:
    found = read_all(tmp_path, range(1_000_000 * FIRST_SEED, 1_000_000 * FIRST_SEED + 10_000))
    print(dict(sorted(found.items())))  # noqa: T201, for whoever asks with -s
