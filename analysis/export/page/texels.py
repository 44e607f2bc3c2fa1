"""What the page knows of every pixel: a normal, a height, and the list of reflectances that it is a sum of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.export.page.columns import Columns
from analysis.pixels.fits import PixelFits
from analysis.results.result import DIFFUSE_REFERENCE_DEG

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Lists:
    """The entries of all pixels, one pixel after the other in reading order, each a column and its weight.

    Attributes
    ----------
    count : ndarray of uint8, shape (P,)
        Entries of each pixel; none where it is not solved.
    column : ndarray of uint16, shape (E,)
    weight : ndarray of float16, shape (E, 3)
        Red, green and blue, in units of `scale`.
    scale : ndarray of float32, shape (N,)
        Largest weight of each column.
    """

    count: NDArray[np.uint8]
    column: NDArray[np.uint16]
    weight: NDArray[np.float16]
    scale: NDArray[np.float32]


def lists_of(fits: PixelFits, columns: Columns) -> Lists:
    """Gather the coefficients of each pixel by column; those of a palette are the same in all channels."""
    n_pixels, n_channels = fits.atom.shape[:2]
    n_columns = len(columns.header)
    solved = np.isfinite(fits.normals[:, 0])[:, None, None]
    pixel, channel, slot = np.nonzero((fits.atom >= 0) & (fits.coefficient > 0.0) & solved)
    key = pixel * max(n_columns, 1) + columns.column_of_atom[fits.atom[pixel, channel, slot]]
    entries, entry = np.unique(key, return_inverse=True)
    sums = np.zeros((len(entries), n_channels))
    np.add.at(sums, (entry, channel), fits.coefficient[pixel, channel, slot])
    weight = np.broadcast_to(sums, (len(entries), 3))
    column = entries % max(n_columns, 1)
    scale = np.zeros(n_columns)
    np.maximum.at(scale, column, weight.max(axis=1))
    return Lists(
        count=np.bincount(entries // max(n_columns, 1), minlength=n_pixels).astype(np.uint8),
        column=column.astype(np.uint16),
        weight=(weight / scale[column, None]).astype(np.float16),
        scale=scale.astype(np.float32),
    )


def normal_plane(normals: Array) -> NDArray[np.uint16]:
    """Return unit vectors as octahedral coordinates of 16 bits, shape (P, 2); NaN as the vector (0, 0, 1).

    p = n_xy / (|n_x| + |n_y| + |n_z|); what looks down is folded over the diagonals.
    """
    n = np.where(np.isfinite(normals), normals, np.array([0.0, 0.0, 1.0]))
    p = n[:, :2] / np.abs(n).sum(axis=1, keepdims=True)
    folded = (1.0 - np.abs(p[:, ::-1])) * np.where(p >= 0.0, 1.0, -1.0)
    p = np.where(n[:, 2:] < 0.0, folded, p)
    # An even number of steps has zero among its values.
    return np.asarray(np.round((p + 1.0) * 32767.0), np.uint16)


def height_plane(depth: Array) -> tuple[NDArray[np.uint16], float, float]:
    """Return heights in 16 bits, and the lowest and the highest in mm; what is unknown is at 0, as in `render`."""
    height = np.nan_to_num(depth)
    low, high = float(height.min()), float(height.max())
    steps = (height - low) / max(high - low, 1e-9) * 65535.0
    return np.asarray(np.round(steps), np.uint16), low, high


def sigma_plane(fits: PixelFits) -> tuple[NDArray[np.uint8], float]:
    """Return the normals' uncertainty in 8 bits, and what the highest value stands for in degrees."""
    sigma = np.nan_to_num(np.rad2deg(fits.normal_sigma))
    known = sigma[sigma > 0.0]
    most = float(np.percentile(known, 99.0)) if len(known) else 1.0
    return np.asarray(np.round(np.clip(sigma / most, 0.0, 1.0) * 255.0), np.uint8), most


def albedo_angle_plane(fits: PixelFits) -> NDArray[np.uint8]:
    """Return the half angle at which `diffuse_albedo` is read, 255 for `DIFFUSE_REFERENCE_DEG`."""
    share = np.nan_to_num(np.rad2deg(fits.theta_h_range[:, 1]) / DIFFUSE_REFERENCE_DEG)
    return np.asarray(np.round(np.clip(share, 0.0, 1.0) * 255.0), np.uint8)
