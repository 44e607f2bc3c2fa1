"""Files of the MERL database of measured isotropic BRDFs [matusik2003]: read, write, average.

A `.binary` file holds three 32-bit integers 90, 90, 180 and then, little-endian in 64-bit floats, the
planes of red, green and blue over (theta_h, theta_d, phi_d), phi_d fastest. Values are scaled by
`SCALES`; a negative one marks a cell that was not measured, most of them below the horizon.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from instrument.files.validation import InvalidInputError, Problem, raise_if_any

Array = NDArray[np.float64]

SUFFIX = ".binary"

SHAPE = (90, 90, 180)

N_BYTES = 3 * 4 + 3 * int(np.prod(SHAPE)) * 8

SCALES = np.array([1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0])

_ABSURD = 1e15  # 1/sr in the file's units; read in the wrong order of bytes, one value in three lies beyond it

UNMEASURED = -1.0

_ACROSS = 100.0  # a step in theta_h costs more than all 90 in theta_d


def cell_angles() -> tuple[Array, Array, Array]:
    """Return theta_h (90,), theta_d (90,) and phi_d (180,) of the cells' centres in radians.

    A cell is found by rounding down sqrt(theta_h / 90 deg) 90, and whole degrees of theta_d and phi_d; the
    centre is half a step on.
    """
    theta_h = (np.arange(SHAPE[0]) + 0.5) ** 2 / SHAPE[0]
    return np.deg2rad(theta_h), np.deg2rad(np.arange(SHAPE[1]) + 0.5), np.deg2rad(np.arange(SHAPE[2]) + 0.5)


@dataclass(frozen=True)
class MerlBrdf:
    """One material.

    Attributes
    ----------
    stored : ndarray, shape (3, 90, 90, 180)
        Red, green and blue as in the file: without the scale, negative where not measured.
    """

    stored: Array

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Which cells were measured, shape (3, 90, 90, 180)."""
        return self.stored >= 0.0

    def average(self) -> tuple[Array, NDArray[np.uint8]]:
        """Average over the measured phi_d.

        Returns
        -------
        mean : ndarray, shape (3, 90, 90)
            1/sr; NaN where no phi_d was measured.
        n_measured : ndarray, shape (3, 90, 90)
            How many of the 180 were.
        """
        measured = self.measured
        n_measured = np.count_nonzero(measured, axis=-1)
        total = np.sum(self.stored, axis=-1, where=measured) * SCALES[:, None, None]
        mean = np.where(n_measured > 0, total / np.maximum(n_measured, 1), np.nan)
        return mean, n_measured.astype(np.uint8)


def fill_unmeasured(mean: Array) -> Array:
    """Fill what is NaN in each (theta_h, theta_d) table with the nearest value that was measured.

    Nearest in theta_d at the same theta_h, because a highlight changes far less along theta_d than along
    theta_h; only a theta_h without any value takes those of the nearest theta_h.

    Parameters
    ----------
    mean : ndarray, shape (C, n_h, n_d)
        Each table with a value somewhere.
    """
    return np.stack([table[tuple(_nearest(np.isnan(table)))] for table in mean])


def _nearest(missing: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the indices, shape (2, n_h, n_d), of the nearest cell that is not missing."""
    found = distance_transform_edt(missing, sampling=(_ACROSS, 1.0), return_distances=False, return_indices=True)
    return np.asarray(found, np.int64)


def read_merl(path: Path) -> MerlBrdf:
    """Read a `.binary` file, about 35 MB.

    Raises
    ------
    InvalidInputError
        With everything that is wrong.
    """
    title = f"{path} cannot be read as a MERL file."
    try:
        raise_if_any(title, _size_problems(path))
        content = path.read_bytes()
    except OSError as error:
        raise InvalidInputError(title, [Problem(str(path), error.strerror or str(error))]) from None
    stored = np.frombuffer(content, "<f8", offset=12).reshape(3, *SHAPE)
    raise_if_any(title, _value_problems(path, stored))
    return MerlBrdf(stored)


def _n_absurd(stored: Array) -> int:
    """Count the values that no reflectance has, measured or not."""
    return int(np.count_nonzero(np.isfinite(stored) & (np.abs(stored) > _ABSURD)))


def _size_problems(path: Path) -> Iterator[Problem]:
    n_bytes = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(12)
    shape = tuple(np.frombuffer(header, "<i4").tolist()) if len(header) == 12 else ()
    if shape and shape != SHAPE:
        yield Problem(str(path), f"begins with the sizes {shape}; those of MERL are {SHAPE}: not a MERL file")
    if n_bytes != N_BYTES:
        how = "was cut short or not copied whole" if n_bytes < N_BYTES else "holds more than one material's table"
        yield Problem(str(path), f"has {n_bytes} bytes; a MERL file has {N_BYTES}: it {how}")


def _value_problems(path: Path, stored: Array) -> Iterator[Problem]:
    if _n_absurd(stored):
        what = "values are beyond any BRDF: no MERL file, or a damaged one; fetch it again"
        if not _n_absurd(stored.byteswap()):
            what = "values are in the other order of bytes (big-endian); MERL's are little-endian. Convert the file"
        yield Problem(str(path), what)
        return
    n_bad = int(np.count_nonzero(~np.isfinite(stored)))
    if n_bad:
        yield Problem(str(path), f"{n_bad} of {stored.size} values are not finite; fetch the file again")
    for name, plane in zip(("red", "green", "blue"), stored, strict=True):
        if not np.any(plane > 0.0):
            yield Problem(str(path), f"no value of {name} is positive: nothing of it was measured")
