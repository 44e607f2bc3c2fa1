"""Files with random, valid headers: the same light, or a refusal by name, never another number and never a crash.

``HALFANGLE_SEED=7 make soak`` begins at another seed than 0; a failure shows the seed and header of its file.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from analysis.registration.registered_pictures import import_registered
from instrument.files.validation import InvalidInputError
from instrument.imports.prepare import prepare_import
from instrument.imports.writing import write_import
from instrument.pictures.picture import Picture, UnreadablePictureError
from instrument.pictures.reading import is_raw, read_picture
from instrument.session.session import Session
from tests.instrument.imports.folders import write_capture
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


def wrong_in_session(made: Made, folder: Path) -> str:
    """Return what is wrong with the session of a file that can be read; the light is compared up to a unit."""
    capture = 'name = "a"\n[grouping]\nexposure_times_s = [1.0]\n'
    picture = read_picture(made.path)
    asked = picture.pixels.dtype == np.uint8 or made.curve
    try:
        prepare_import(folder, write_capture(folder, capture))
    except InvalidInputError as error:
        if not asked:
            return f"is refused: {error}"
    else:
        if asked:
            return "is taken for linear without a word"
    try:
        write_import(prepare_import(folder, write_capture(folder, f"linear = true\n{capture}")), folder / "s.h5")
    except InvalidInputError as error:
        # Levels that contradict each other, such as no light above the black level.
        return "" if "black must be less" in str(error) else f"is refused: {error}"
    with Session(folder / "s.h5") as session:
        counts, cell = session.frame(0, 0), session.nominal.black_level_cell
        camera = session.camera
    black = np.full((2, 2), camera.black_level) if cell is None else cell
    stated = np.reshape(picture.black_level or (0.0,) * 4, (2, 2))
    # Counts at the upper end of 16 bits are shifted down, and so are levels.
    for shift in range(9):
        factor = float(2**shift)
        same = np.array_equal(counts.astype(np.float64) * factor, picture.pixels.astype(np.float64))
        if same and np.allclose(black * factor, stated):
            return "" if camera.bayer_pattern == (picture.bayer_pattern or "") else "has another pattern"
    return f"has other values: {counts.ravel()[:5]} with {black.ravel()}"


def wrong_in_stack(made: Made, folder: Path) -> str:
    """Return what is wrong with the stack of a file that can be read, as a picture that is registered."""
    (folder / "p.csv").write_text(f"file,camera_x_mm,camera_y_mm,camera_z_mm\n{made.path.name},0,0,300\n")
    picture = read_picture(made.path)
    whole = picture.pixels.dtype.kind == "u"
    largest = (picture.saturation_level or float(np.iinfo(picture.pixels.dtype).max)) if whole else 1.0
    fits = not is_raw(made.path) and not picture.bayer_pattern and picture.orientation == 1
    try:
        stack = import_registered(folder, folder / "p.csv", 20.0, 1.0, 1)
    except InvalidInputError as error:
        return f"is refused: {error}" if fits and min(picture.pixels.shape[:2]) > 1 else ""
    if not fits:
        return "is read, and cannot be"
    radiance = stack.radiance[0] if picture.pixels.ndim == 3 else stack.radiance[0, ..., 0]
    meant = np.maximum(picture.pixels.astype(np.float64), 0.0) / largest
    clipped = stack.saturated[0].reshape(radiance.shape) > 0
    if not np.array_equal(clipped, picture.pixels >= largest if whole else np.zeros(radiance.shape, bool)):
        return "clips elsewhere"
    return "" if np.allclose(radiance, meant, rtol=1e-6, atol=0) else "has other values"


def campaign(folder: Path, seeds: range, whole_way: int) -> Counter[str]:
    """Read a file of each seed, and every `whole_way`-th into a session and a stack; return what became of them."""
    told: list[str] = []
    found: Counter[str] = Counter()
    for seed in seeds:
        file = made(folder, seed)
        outcomes = [wrong(file)]
        if not outcomes[0] and seed % whole_way == 0:
            outcomes += [wrong_in_session(file, folder), wrong_in_stack(file, folder)]
        bad = [outcome for outcome in outcomes if outcome not in ("", "refused")]
        told += [f"seed {seed}: {file.path.name} {outcome}\n    {file.header}" for outcome in bad]
        found[f"{file.path.suffix} {outcomes[0] or 'read'}"] += 1
        for path in folder.iterdir():
            path.unlink()
    assert not told, "\n".join([f"{len(told)} of {len(seeds)} files:", *told[:40]])
    return found


def test_hundreds_of_files_give_their_light_or_are_refused(tmp_path: Path) -> None:
    found = campaign(tmp_path, range(300), 10)
    for suffix in (".tif", ".dng", ".exr", ".png", ".npy", ".hdr", ".bmp", ".pfm"):
        assert found[f"{suffix} read"]
        assert found[f"{suffix} refused"]


@pytest.mark.slow
def test_thousands_of_files_give_their_light_or_are_refused(tmp_path: Path) -> None:
    first = 1_000_000 * FIRST_SEED
    found = campaign(tmp_path, range(first, first + 10_000), 10)
    print(dict(sorted(found.items())))  # noqa: T201, for whoever asks with -s
