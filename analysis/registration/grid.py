"""The grid of pixels on the sample that all views are resampled to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Grid:
    """Pixels on the sample: row i, column j is centred on x = (j - (W-1)/2) pitch, y = ((H-1)/2 - i) pitch.

    Attributes
    ----------
    height, width : int
    pitch : float
        Millimetres.
    """

    height: int
    width: int
    pitch: float

    @classmethod
    def covering(cls, area_mm: tuple[float, float], pitch: float) -> Grid:
        """Build the grid of square pixels whose outer edges cover `area_mm` (width, height)."""
        return cls(max(int(round(area_mm[1] / pitch)), 1), max(int(round(area_mm[0] / pitch)), 1), pitch)

    def points(self, depth: Array | None = None) -> Array:
        """Return the centres in the sample frame, mm, shape (height, width, 3); z = `depth`, or 0."""
        x = (np.arange(self.width) - (self.width - 1) / 2) * self.pitch
        y = ((self.height - 1) / 2 - np.arange(self.height)) * self.pitch
        xx, yy = np.meshgrid(x, y)
        return np.stack([xx, yy, np.zeros_like(xx) if depth is None else depth], axis=-1)

    def blocks(self, pixels: NDArray[np.int64], n: int) -> NDArray[np.int64]:
        """Return the number of the part of the area, `n` parts a side, that each pixel (flat index) lies in."""
        rows, columns = np.divmod(pixels, self.width)
        return np.asarray(rows * n // self.height * n + columns * n // self.width)

    def points_of(self, pixels: NDArray[np.int64], depth: Array | None = None) -> Array:
        """Return the centres of some pixels (flat indices) as `points` does, shape (P, 3)."""
        i, j = np.divmod(pixels, self.width)
        x = (j - (self.width - 1) / 2) * self.pitch
        y = ((self.height - 1) / 2 - i) * self.pitch
        return np.stack([x, y, np.zeros(len(pixels)) if depth is None else depth.ravel()[pixels]], axis=-1)
