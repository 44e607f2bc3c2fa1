"""The real cases: photographs of telephones, a dome, and scenes of measured materials.

None of the data is part of this project; it is read from HALFANGLE_SHARED_DATA, or shared/data beside the checkout.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.rgl_file import read_rgl
from analysis.registration.registered_pictures import import_registered
from analysis.registration.stack import Stack
from analysis.registration.stack_file import read_stack
from benchmarks.common.scenes import POSES, relief_of
from instrument.files.validation import InvalidInputError, Problem

Array = NDArray[np.float64]

SHARED = Path(os.environ.get("HALFANGLE_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data"))

GAMMA, BINNING = 2.2, 4

RELIEF_SIZE, N_MATERIALS, NOISE = 64, 4, 0.005

RELIEF_VIEWS = (7, 25)


@dataclass(frozen=True)
class Capture:
    """A capture to reconstruct.

    Attributes
    ----------
    name : str
    stack : Stack
    normals : ndarray, shape (P, 3), or None
        True ones; NaN outside the object.
    torch_mm : (float, float) or None
        Where the light stands beside the lens as others found it from the highlights, camera frame (y down).
    """

    name: str
    stack: Stack
    normals: Array | None = None
    torch_mm: tuple[float, float] | None = None


def captures(seed: int, shared: Path = SHARED) -> Iterator[Capture]:
    """Yield the cases one by one.

    Raises
    ------
    InvalidInputError
        If the data is not at hand.
    """
    if not shared.is_dir():
        what = "is no folder; name that of the real captures in HALFANGLE_SHARED_DATA"
        raise InvalidInputError("The real cases cannot be run.", [Problem(str(shared), what)])
    yield Capture("card", _photographs(shared / "real_card", 68.48), torch_mm=(3.1, 11.1))
    yield Capture("yellow box", _photographs(shared / "yellow_box", 108.8), torch_mm=(-18.0, 9.0))
    truth = np.load(shared / "dome" / "ball.truth.npz")
    normals = np.where(truth["mask"][..., None] > 0, truth["normals"], np.nan).reshape(-1, 3)
    yield Capture("ball in a dome", read_stack(shared / "dome" / "ball.stack.h5"), normals)
    yield from _measured(seed, shared / "measured_brdf")


def _photographs(folder: Path, width_mm: float) -> Stack:
    return import_registered(folder, folder / "positions.csv", width_mm, GAMMA, BINNING)


def _measured(seed: int, folder: Path) -> Iterator[Capture]:
    """Yield reliefs of measured materials, which no dictionary here was made of."""
    files = sorted(folder.glob("*.bsdf"))
    rng = np.random.default_rng(seed)
    for n_views in RELIEF_VIEWS:
        drawn = [files[i] for i in np.sort(rng.choice(len(files), min(N_MATERIALS, len(files)), replace=False))]
        brdfs = [read_rgl(file).evaluate for file in drawn]
        poses = POSES["cap"](n_views, rng)
        scene = relief_of(brdfs, RELIEF_SIZE, poses, NOISE, rng)
        assert scene.truth is not None
        name = f"relief of measured materials, {n_views} views"
        yield Capture(name, scene, scene.truth.normals.reshape(-1, 3))
