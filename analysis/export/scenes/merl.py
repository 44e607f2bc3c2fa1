"""Writes the palette's materials as files of the MERL database beside the maps, which weigh them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.export.record import Record
from analysis.palette.materials import leading_material
from analysis.pixels.fits import PixelFits
from analysis.reflectance.merl import SCALES, SHAPE, UNMEASURED, cell_angles
from analysis.reflectance.models import cosines_from_angles
from instrument.files.whole_file import write_whole

Array = NDArray[np.float64]


def write_merl_tables(folder: Path, stem: str, record: Record) -> dict[str, str]:
    """Write `<stem>_material<k>.binary` for each material that leads in some pixel, at its typical level there.

    Parameters
    ----------
    folder : Path
    stem : str
        What the maps' names begin with.
    record : Record

    Returns
    -------
    dict of str to str
        What each file is, by its name.
    """
    fits, scale = record.prepared.result.fits, record.prepared.scale.factor
    leading = np.where(np.isfinite(fits.normals[:, 0]), leading_material(fits), -1)
    files = {}
    for k in np.unique(leading[leading >= 0]).tolist():
        level = float(np.median(np.sum(fits.coefficient[leading == k, 0], axis=-1)))
        values = scale * level * material_values(fits, k)
        name = f"{stem}_material{k:02d}.binary"
        files[name] = f"MERL: the completed BRDF of the palette's material {k} at its typical level"
        stored = (values / SCALES[:, None, None, None]).clip(UNMEASURED).astype("<f8")
        write_whole(folder / name, struct.pack("<3i", *SHAPE) + stored.tobytes())
    return files


def material_values(fits: PixelFits, material: int) -> Array:
    """Return a material of the palette on MERL's grid, 1/sr, shape (3, 90, 90, 180); -inf below the horizon."""
    theta_h, theta_d, phi_d = cell_angles()
    cosines, above = cosines_from_angles(theta_h[:, None, None], theta_d[:, None], phi_d)
    n_channels = fits.atom.shape[1]
    atoms = fits.dictionary.atoms[material * n_channels : (material + 1) * n_channels]
    values = np.stack([np.where(above, atom.evaluate(cosines), -np.inf) for atom in atoms])
    return np.asarray(np.broadcast_to(values, (3, *SHAPE)))
