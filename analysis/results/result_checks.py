"""Checks that a result file is complete, before any of it is read."""

from __future__ import annotations

from collections.abc import Iterator

import h5py
import numpy as np

from analysis.pixels.fits import PixelFits
from analysis.registration.grid import Grid
from instrument.files.untrusted import number_problems, text_problems
from instrument.files.validation import Problem

Shape = tuple[int | str, ...]

MAX_COEFFICIENT = 1e37
"""What single precision holds, and no more: coefficients have the unit of the stack's radiance times the squared
distance, whichever that is."""

# The depth comes first: all maps have its shape. C channels, J atoms of a pixel, K atoms in all.
_NUMBERS: dict[str, Shape] = {
    "/entry/result/depth": ("H", "W"),
    "/entry/result/depth_sigma": ("H", "W"),
    "/entry/result/normals": ("H", "W", 3),
    "/entry/result/normal_covariance": ("H", "W", 3),
    "/entry/result/reduced_chi2": ("H", "W"),
    "/entry/result/theta_h_range": ("H", "W", 2),
    "/entry/result/flags": ("H", "W"),
    "/entry/result/pixel_pitch": (),
    "/entry/brdf/atom": ("H", "W", "C", "J"),
    "/entry/brdf/coefficient": ("H", "W", "C", "J"),
    "/entry/brdf/atom_parameters": ("K", 2),
}

_OPTIONAL: dict[str, Shape] = {
    "/entry/result/normal_error_deg": ("H", "W"),
    "/entry/brdf/band/log_sigma": ("M", "C", "h", "d"),
    "/entry/brdf/band/theta_h": ("h",),
    "/entry/brdf/band/theta_d": ("d",),
    "/entry/brdf/band/seen": ("M", 2),
    "/entry/views/camera_position": ("V", 3),
    "/entry/views/light_position": ("V", 3),
    "/entry/views/light_power": ("V",),
    "/entry/views/relative_error": (),
    "/entry/views/floor": (),
    "/entry/views/level": (),
}

_INTEGERS = ("/entry/result/flags", "/entry/brdf/atom")

_TEXTS = ("/entry/choices", "/entry/stages", "/entry/summary", "/entry/brdf/atom_model")


def result_problems(file: h5py.File) -> Iterator[Problem]:
    """Yield everything that is missing, mis-shaped or too large, by its path in the file."""
    dims: dict[str, int] = {}
    present = {path: shape for path, shape in _OPTIONAL.items() if path in file}
    for path, shape in (_NUMBERS | present).items():
        yield from number_problems(file.get(path), path, shape, dims)
    for path in _INTEGERS:
        found = file.get(path)
        if isinstance(found, h5py.Dataset) and found.dtype.kind == "f":
            yield Problem(path, f"has type {found.dtype}; must be integers")
    for path in _TEXTS:
        yield from text_problems(file.get(path), path)
    if 0 in dims.values() or dims.get("C", 1) not in (1, 3):
        sizes = ", ".join(f"{name} = {size}" for name, size in dims.items())
        yield Problem("/entry/brdf/atom", f"has sizes {sizes}; none may be 0, and channels are 1 or 3")


def value_problems(fits: PixelFits, grid: Grid) -> Iterator[Problem]:
    """Yield which values of solved pixels nothing can be predicted from."""
    solved = np.asarray(np.isfinite(fits.normals).all(axis=1))
    used = np.where((fits.atom >= 0) & solved[:, None, None], fits.coefficient, 0.0)
    n_bad = int(np.count_nonzero(~(np.abs(used) <= MAX_COEFFICIENT).all(axis=(1, 2))))
    if n_bad:
        yield Problem("/entry/brdf/coefficient", f"is not finite, or beyond {MAX_COEFFICIENT:g}, in {n_bad} pixels")
    seen = fits.theta_h_range[solved]
    if not bool(np.all((seen >= 0.0) & (seen <= np.pi / 2 + 1e-6) & (seen[:, :1] <= seen[:, 1:]))):
        yield Problem("/entry/result/theta_h_range", "must ascend within 0 to pi / 2 wherever there is a normal")
    if not (np.isfinite(grid.pitch) and grid.pitch > 0.0):
        yield Problem("/entry/result/pixel_pitch", f"is {grid.pitch}; must be a positive number of mm")
