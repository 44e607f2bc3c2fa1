"""Which half angles the views reach on a flat sample whose relief leans a little in all directions.

A pixel shows its highlight only to views whose half vector lies near its normal. The relief's slopes are not
known before the reconstruction, so all normals up to `SLOPE_DEG` from the sample's are taken as likely.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SLOPE_DEG = 15.0

BIN_DEG = 5.0

JUDGED_TO_DEG = 40.0
"""Half angles up to which a gap is told; beyond, curves are nearly flat."""

MIN_VIEWS, MIN_VIEWS_FIRST = 1.0, 0.5
"""Views that the typical slope should have in each bin, and in the first one, which is small."""

_CLEARLY = 0.25  # views

_N_POINTS = 6  # a side, over the area

_RINGS, _AZIMUTHS = (0.5, 1.0), 8  # of slopes: shares of SLOPE_DEG, and directions of each

_HALVES = {"left": (0, -1), "right": (0, 1), "bottom": (1, -1), "top": (1, 1)}


@dataclass(frozen=True, slots=True)
class Coverage:
    """How many views see a point at which half angle, mean over the points and slopes named.

    Attributes
    ----------
    edges_deg : ndarray, shape (n_bins + 1,)
        Of the bins of theta_h.
    all_over : ndarray, shape (n_bins,)
        Views in each bin, over the whole area and all slopes.
    halves : dict of str to ndarray, shape (n_bins,)
        Over the ``left``, ``right``, ``bottom`` and ``top`` half of the area, all slopes.
    slopes : dict of str to ndarray, shape (n_bins,)
        Over the whole area, for slopes that face ``left``, ``right``, ``bottom`` and ``top``.
    smallest_deg, largest_deg : float
        Every slope of every point is seen this close to its highlight, and as far from it.
    """

    edges_deg: Array
    all_over: Array
    halves: dict[str, Array]
    slopes: dict[str, Array]
    smallest_deg: float
    largest_deg: float

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON has it."""
        return {
            "theta_h_edges_deg": self.edges_deg.tolist(),
            "views_all_over": self.all_over.tolist(),
            "views_on_half": {name: views.tolist() for name, views in self.halves.items()},
            "views_for_slopes_facing": {name: views.tolist() for name, views in self.slopes.items()},
            "smallest_deg": self.smallest_deg,
            "largest_deg": self.largest_deg,
            "advice": list(self.advice()),
        }

    def advice(self) -> tuple[str, ...]:
        """Return what poses to add, empty if none is missing."""
        lacking = _lacking(self.all_over)
        slopes = _of_parts(self.slopes, "for slopes that face {0}: camera and light from the {0}", lacking)
        return (*_texts(_gaps(self.all_over)), *slopes, *_of_parts(self.halves, "on the {0} half", lacking))


def coverage(camera_position: Array, light_position: Array, area_mm: tuple[float, float]) -> Coverage:
    """Count the views in bins of theta_h.

    Parameters
    ----------
    camera_position, light_position : ndarray, shape (n_views, 3)
        Sample frame, mm.
    area_mm : tuple of float
        Width and height, centred on the origin.
    """
    points, normals = _points(area_mm), _normals()
    theta = _theta_h(camera_position, light_position, points, normals)
    edges = np.arange(0.0, 90.0 + BIN_DEG, BIN_DEG)
    which = np.digitize(theta, edges) - 1
    counts = np.stack([(which == b).sum(axis=0) for b in range(len(edges) - 1)], axis=-1)
    halves = {name: counts[side * points[:, axis] > 0].mean(axis=(0, 1)) for name, (axis, side) in _HALVES.items()}
    leans = {name: counts[:, side * normals[:, axis] > 0.1].mean(axis=(0, 1)) for name, (axis, side) in _HALVES.items()}
    nearest = np.min(np.where(np.isnan(theta), 90.0, theta), axis=0)
    farthest = np.max(np.where(np.isnan(theta), 0.0, theta), axis=0)
    return Coverage(edges, counts.mean(axis=(0, 1)), halves, leans, float(nearest.max()), float(farthest.min()))


def _points(area_mm: tuple[float, float]) -> Array:
    """Return points spread over the area, none on its axes, shape (n_points, 3)."""
    share = (np.arange(_N_POINTS) + 0.5) / _N_POINTS - 0.5
    x, y = np.meshgrid(share * area_mm[0], share * area_mm[1])
    return np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)


def _normals() -> Array:
    """Return unit normals up to `SLOPE_DEG` from z, shape (n_normals, 3)."""
    azimuth = 2.0 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    rings = [np.zeros((1, 2))]
    rings += [np.sin(np.deg2rad(r * SLOPE_DEG)) * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1) for r in _RINGS]
    lateral = np.concatenate(rings)
    return np.concatenate([lateral, np.sqrt(1.0 - np.sum(lateral**2, axis=1, keepdims=True))], axis=1)


def _theta_h(camera: Array, light: Array, points: Array, normals: Array) -> Array:
    """Return half angles, degrees, shape (n_views, n_points, n_normals); NaN where unlit or unseen."""
    omega_o, omega_i = (_unit(p[:, None] - points) for p in (camera, light))
    h = _unit(omega_i + omega_o)
    seen = (omega_o @ normals.T > 0.0) & (omega_i @ normals.T > 0.0)
    return np.where(seen, np.rad2deg(np.arccos(np.clip(h @ normals.T, -1.0, 1.0))), np.nan)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _lacking(views: Array) -> Array:
    """Return how many views are missing in each judged bin."""
    n = round(JUDGED_TO_DEG / BIN_DEG)
    wanted = np.where(np.arange(n) == 0, MIN_VIEWS_FIRST, MIN_VIEWS)
    return np.maximum(wanted - views[:n], 0.0)


def _gaps(views: Array, but: Array | float = 0.0) -> list[tuple[int, str]]:
    """Return runs of bins where more views than `but` are missing: how many poses fill them, and "5-15" degrees.

    One pose fills a bin for the share of the slopes that its ring of half vectors covers.
    """
    lacking = _lacking(views)
    edge = np.deg2rad(BIN_DEG * np.arange(len(lacking) + 1))
    share = np.minimum(-np.diff(np.cos(edge)) / (1.0 - np.cos(np.deg2rad(SLOPE_DEG))), 1.0)
    poses = np.where(lacking > but, np.ceil(lacking / share - 1e-9), 0).astype(int)
    starts = np.flatnonzero((poses > 0) & ~np.concatenate([[False], poses[:-1] > 0]))
    ends = np.flatnonzero((poses > 0) & ~np.concatenate([poses[1:] > 0, [False]])) + 1
    return [(int(poses[a:b].max()), f"{a * BIN_DEG:.0f}-{b * BIN_DEG:.0f}") for a, b in zip(starts, ends, strict=True)]


def _of_parts(parts: dict[str, Array], where: str, lacking_all_over: Array) -> list[str]:
    """Return advice for parts of the area, or of the slopes, that lack clearly more than all do together."""
    return [
        f"{text} {where.format(name)}"
        for name, views in parts.items()
        for text in _texts(_gaps(views, lacking_all_over + _CLEARLY))
    ]


def _texts(gaps: list[tuple[int, str]]) -> list[str]:
    return [f"add {n} {'pose' if n == 1 else 'poses'} near {span} deg" for n, span in gaps]
