"""The views as they were fitted: where camera and light stood in the end, and how far samples may be off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.problem import Noise
from analysis.reconstruction.reconstruction import Reconstruction
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

_NAMES = ("camera_position", "light_position", "light_power")

_UNITS = {"camera_position": "mm", "light_position": "mm", "level": "mm"}


@dataclass(frozen=True, slots=True)
class FittedViews:
    """The N views of a stack with what the reconstruction corrected of them.

    Attributes
    ----------
    camera_position, light_position : ndarray, shape (N, 3)
        Sample frame, mm.
    light_power : ndarray, shape (N,)
        Relative; NaN = a view that was left out.
    noise : Noise
    level : float
        How far the surface along which the views were resampled lay above the result's depth, mm; NaN where they were
        taken as registered.
    """

    camera_position: Array
    light_position: Array
    light_power: Array
    noise: Noise
    level: float

    @classmethod
    def of(cls, reconstruction: Reconstruction) -> FittedViews:
        """Gather what a reconstruction ended with."""
        stack = reconstruction.stack
        level = np.nan if stack.followed is None else float(np.nanmean(stack.followed - reconstruction.depth))
        return cls(stack.camera_position, stack.light_position, stack.light_power, reconstruction.noise, level)

    def applied_to(self, stack: Stack, depth: Array) -> Stack:
        """Return the stack as it was fitted.

        Parameters
        ----------
        stack : Stack
            That the result came from.
        depth : ndarray, shape (H, W)
            The result's, mm.
        """
        followed = None if np.isnan(self.level) else depth + self.level
        return replace(
            stack,
            camera_position=self.camera_position,
            light_position=self.light_position,
            light_power=self.light_power,
            followed=followed,
        )


def write_views(group: Any, views: FittedViews) -> None:
    """Write them into a group of a result file."""
    group.attrs["meaning"] = "the views as they were fitted; level: of the surface they follow above depth, NaN = none"
    values = {name: getattr(views, name) for name in (*_NAMES, "level")}
    values |= {"relative_error": views.noise.relative, "floor": views.noise.floor}
    for name, value in values.items():
        group.create_dataset(name, data=value).attrs.update({"units": _UNITS[name]} if name in _UNITS else {})


def read_views(group: Any) -> FittedViews:
    """Read them from a group whose shapes have been checked."""
    camera, light, power = (group[name][...].astype(np.float64) for name in _NAMES)
    noise = Noise(float(group["relative_error"][()]), float(group["floor"][()]))
    return FittedViews(camera, light, power, noise, float(group["level"][()]))
