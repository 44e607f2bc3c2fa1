"""The registered stack: views resampled onto the sample plane, and where camera and light stood."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.registration.grid import Grid

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """What is known of a simulated sample; read only to score.

    Attributes
    ----------
    normals : ndarray, shape (height, width, 3)
    depth : ndarray, shape (height, width)
        Millimetres.
    material : ndarray of int, shape (height, width), or None
    """

    normals: Array
    depth: Array
    material: NDArray[np.int64] | None = None


@dataclass(frozen=True)
class Stack:
    """A registered stack of N views of H x W pixels in C channels (1 or 3).

    Attributes
    ----------
    radiance : ndarray of float32, shape (N, H, W, C)
        Linear, relative; NaN = not seen by this view. This, `variance` and `saturated` may be the datasets of an open
        file instead: take them view by view.
    camera_position, light_position : ndarray, shape (N, 3)
        Sample frame, mm.
    pixel_pitch : float
        Millimetres.
    light_power : ndarray, shape (N,)
        Relative; NaN = a view to leave out.
    variance : ndarray of float32, shape (N, H, W, C), or None
    saturated : ndarray of uint8, shape (N, H, W, C), or None
        1 = clipped; radiance is a lower bound.
    pixels : {"surface", "independent"}
        Whether neighbours lie on one surface.
    camera_rotation : ndarray, shape (N, 3, 3), or None
        Sample to camera (x right, y down, z forward); lets a light offset be stated in the camera frame.
    light_offset, light_offset_sigma : ndarray, shape (3,), or None
        Of the light from the lens in the camera frame, mm, with one standard deviation.
    light_power_sigma : ndarray, shape (N,), or None
        One standard deviation of each view's power relative to the others, as a share of it.
    registration_sigma : ndarray, shape (N,), or None
        How far each view may be shifted against the grid, one standard deviation per axis, mm.
    falloff_sigma : float or None
        Error left in the correction of vignetting and lobe, one standard deviation, as a share, at the area's border.
    followed : ndarray, shape (H, W), or None
        Depth in mm along which the views are resampled where pixels are taken from them; None = as registered.
    truth : Truth or None
    notes : dict
        Texts by the names in `analysis.registration.stack_file.NOTES`.
    """

    radiance: NDArray[np.float32]
    camera_position: Array
    light_position: Array
    pixel_pitch: float
    light_power: Array
    variance: NDArray[np.float32] | None = None
    saturated: NDArray[np.uint8] | None = None
    pixels: str = "surface"
    camera_rotation: Array | None = None
    light_offset: Array | None = None
    light_offset_sigma: Array | None = None
    light_power_sigma: Array | None = None
    registration_sigma: Array | None = None
    falloff_sigma: float | None = None
    followed: Array | None = None
    truth: Truth | None = None
    notes: dict[str, str] = field(default_factory=dict)

    @property
    def grid(self) -> Grid:
        """The pixels of the area."""
        return Grid(self.radiance.shape[1], self.radiance.shape[2], self.pixel_pitch)

    @property
    def n_views(self) -> int:
        """N."""
        return int(self.radiance.shape[0])

    @property
    def states_errors(self) -> bool:
        """Whether it says how well its geometry and its light are known."""
        stated = (self.light_offset_sigma, self.light_power_sigma, self.registration_sigma, self.falloff_sigma)
        return any(value is not None for value in stated)

    def binned(self, n: int) -> Stack:
        """Return the stack with squares of n x n pixels averaged, what is left over at the border cut off."""
        if n == 1:
            return self
        height, width = self.radiance.shape[1] // n, self.radiance.shape[2] // n

        def squares(view: NDArray[Any]) -> NDArray[Any]:
            cut = view[: height * n, : width * n].reshape(height, n, width, n, -1)
            return cut.transpose(0, 2, 4, 1, 3).reshape(height, width, -1, n * n)

        def binned(views: Any, reduce: Callable[[NDArray[Any]], NDArray[Any]], dtype: type) -> Any:
            return None if views is None else np.stack([reduce(squares(v)).astype(dtype) for v in views])

        return replace(
            self,
            # A square that a view sees in part is not seen by it.
            radiance=binned(self.radiance, lambda s: s.mean(axis=-1), np.float32),
            variance=binned(self.variance, lambda s: s.mean(axis=-1) / n**2, np.float32),
            saturated=binned(self.saturated, lambda s: s.max(axis=-1), np.uint8),
            pixel_pitch=self.pixel_pitch * n,
            followed=None if self.followed is None else squares(self.followed).mean(axis=-1)[..., 0],
            truth=None,
        )

    def without_view(self, view: int) -> Stack:
        """Return the stack with one view that no solver looks at; no radiance is copied."""
        power = self.light_power.copy()
        power[view] = np.nan
        return replace(self, light_power=power)
