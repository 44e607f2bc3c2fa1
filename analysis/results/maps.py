"""The maps of a result to be looked at: values with their unit, and the span that a scale should cover."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from analysis.drawing.colours import display_colours, normal_colours
from analysis.palette.materials import group_materials
from analysis.results.result import Result, diffuse_albedo

Array = NDArray[np.float64]


class Kind(Enum):
    """How a map is to be drawn."""

    COLOURS = "colours"
    SCALE = "scale"
    CATEGORIES = "categories"


@dataclass(frozen=True, slots=True)
class ResultMap:
    """One map.

    Attributes
    ----------
    kind : Kind
    values : ndarray, shape (H, W) or (H, W, C)
        What is to be read at a pixel; NaN = unknown, and so is a category below 0.
    unit : str
        Of the values; empty for plain numbers.
    colours : ndarray, shape (H, W, 3), or None
        Display colours, 0 to 1, of a map of colours.
    """

    kind: Kind
    values: Array
    unit: str = ""
    colours: Array | None = None

    @property
    def span(self) -> tuple[float, float]:
        """Smallest and largest value of a scale: the 1st and the 99th percentile."""
        finite = self.values[np.isfinite(self.values)]
        low, high = np.percentile(finite, [1, 99]) if finite.size else (0.0, 1.0)
        return float(low), float(max(high, low + 1e-9 * max(abs(low), 1.0)))


def _albedo(result: Result) -> ResultMap:
    albedo = result.as_map(diffuse_albedo(result.fits))
    return ResultMap(Kind.COLOURS, albedo, colours=display_colours(albedo))


def _scale(values: Array, unit: str = "") -> ResultMap:
    return ResultMap(Kind.SCALE, values, unit)


MAPS: dict[str, Callable[[Result], ResultMap]] = {
    "normals": lambda result: ResultMap(Kind.COLOURS, result.normals, colours=normal_colours(result.normals)),
    "depth": lambda result: _scale(result.depth, "mm"),
    "albedo": _albedo,
    "materials": lambda r: ResultMap(Kind.CATEGORIES, r.as_map(group_materials(r.fits)).astype(np.float64)),
    "normal sigma": lambda result: _scale(result.as_map(np.rad2deg(result.fits.normal_sigma)), "deg"),
    "depth sigma": lambda result: _scale(result.depth_sigma, "mm"),
    "residual": lambda result: _scale(np.sqrt(result.as_map(result.fits.reduced_chi2)), "sigma"),
}
"""By name."""


def relit(result: Result, camera: Array, light: Array) -> ResultMap:
    """Return the area as a camera sees it in the light of a lamp, sample frame, mm, each of shape (3,)."""
    radiance = result.render(camera, light)
    return ResultMap(Kind.COLOURS, radiance, colours=display_colours(radiance))
