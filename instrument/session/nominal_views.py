"""Nominal views of the sample: poses as configured, seen through an ideal lens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NominalViews:
    """P poses of a sample before one camera and one light.

    Attributes
    ----------
    lens, light : ndarray, shape (P, 3)
        Where they stand in the sample frame, mm.
    rotation : ndarray, shape (P, 3, 3)
        Sample to camera.
    focal_length_px : float
        Pixels of a raw frame; the principal point is its centre, and nothing is distorted.
    height, width : int
        Pixels of a raw frame.
    area_mm : tuple of float
        Width and height of the area to reconstruct, centred on the sample's origin.
    """

    lens: Array
    light: Array
    rotation: Array
    focal_length_px: float
    height: int
    width: int
    area_mm: tuple[float, float]

    @property
    def n_poses(self) -> int:
        """P."""
        return len(self.lens)

    def camera_matrix(self, block: int = 1) -> Array:
        """Return the intrinsics, shape (3, 3), of a picture whose pixels are blocks of so many pixels a side."""
        f = self.focal_length_px / block
        # The centre of the first block is (block - 1) / 2 pixels from that of the first pixel.
        x, y = (((n - 1) / 2 - (block - 1) / 2) / block for n in (self.width, self.height))
        return np.array([[f, 0.0, x], [0.0, f, y], [0.0, 0.0, 1.0]])
