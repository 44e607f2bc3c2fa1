"""MERL files made from published fits, since the measured ones may not be carried here."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.reflectance import models
from analysis.reflectance.atoms import published
from analysis.reflectance.merl import MerlBrdf, cell_angles, write_merl
from analysis.reflectance.models import cosines_from_angles


def merl_brdf(row: int) -> MerlBrdf:
    """Return the SGD fit of one material on MERL's grid, unmeasured below the horizon."""
    theta_h, theta_d, phi_d = cell_angles()
    cosines, above = cosines_from_angles(theta_h[:, None, None], theta_d[:, None], phi_d)
    value = np.moveaxis(models.sgd(cosines, published("sgd")[row]), -1, 0)
    return MerlBrdf.from_brdf(np.where(above, value, np.nan))


def write_materials(folder: Path, **rows: int) -> Path:
    """Write a file for each name, made of that row of the table; return the folder."""
    folder.mkdir(exist_ok=True)
    for name, row in rows.items():
        write_merl(folder / f"{name.replace('_', '-')}.binary", merl_brdf(row))
    return folder
