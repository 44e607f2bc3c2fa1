"""MERL files made from published fits, since the measured ones may not be carried here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance import models
from analysis.reflectance.atoms import published
from analysis.reflectance.merl import SCALES, SHAPE, UNMEASURED, MerlBrdf, cell_angles
from analysis.reflectance.models import cosines_from_angles


def merl_brdf(row: int) -> MerlBrdf:
    """Return the SGD fit of one material on MERL's grid, unmeasured below the horizon."""
    theta_h, theta_d, phi_d = cell_angles()
    cosines, above = cosines_from_angles(theta_h[:, None, None], theta_d[:, None], phi_d)
    value = np.moveaxis(models.sgd(cosines, published("sgd")[row]), -1, 0)
    return merl_of(np.where(above, value, np.nan))


def write_materials(folder: Path, **rows: int) -> Path:
    """Write a file for each name, made of that row of the table; return the folder."""
    folder.mkdir(exist_ok=True)
    for name, row in rows.items():
        write_merl(folder / f"{name.replace('_', '-')}.binary", merl_brdf(row))
    return folder


def merl_of(value: NDArray[np.float64]) -> MerlBrdf:
    """Take a BRDF in 1/sr, shape (3, 90, 90, 180); NaN = not measured."""
    stored = value / SCALES[:, None, None, None]
    return MerlBrdf(np.where(np.isnan(stored), UNMEASURED, stored))


def write_merl(path: Path, brdf: MerlBrdf) -> None:
    """Write a new `.binary` file, as MERL's are."""
    with path.open("xb") as file:
        file.write(np.array(SHAPE, "<i4").tobytes())
        file.write(brdf.stored.astype("<f8", copy=False).tobytes())
