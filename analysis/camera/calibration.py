"""Intrinsics of the camera, its pose in every view and the boards' places, from the corners of the boards.

The lens model is the smallest that the corners support: a group of unknowns that lies within
sqrt(k ln n) of nothing, in units of its own covariance, is taken out again [schwarz1978]. So are the
places of the boards, if the layout of the rig file explains the corners as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.camera.board_detection import BoardCorners
from analysis.camera.board_layout import BoardLayout, cross_matrix
from analysis.camera.bundle_adjustment import Bundle, CornerNoise, Freedom, adjust, drop, own_variance
from analysis.camera.initialisation import first_lens, first_state
from analysis.camera.lens import LENS_NAMES, Lens
from analysis.camera.view import View
from instrument.files.validation import InvalidInputError, Problem

Array = NDArray[np.float64]

MIN_CORNERS = 8
"""Fewest corners of a view that is used: a pose has six unknowns, and a few must be left to judge it by."""

MIN_VIEWS = 4

OUTLIER = 6.0
"""A corner whose residual exceeds this many sigmas is left out."""

# What may be taken out of the lens model, as one, and what has to be out before.
_GROUPS = ((("k3",), ""), (("k2",), "k3"), (("k1",), "k2"), (("p1", "p2"), ""), (("aspect",), ""))


@dataclass(frozen=True, slots=True)
class CornerOutlier:
    """A corner that was left out.

    Attributes
    ----------
    view, board : int
    point : tuple of float
        Pixels.
    residual : tuple of float
        Found minus predicted, pixels.
    """

    view: int
    board: int
    point: tuple[float, float]
    residual: tuple[float, float]


@dataclass(frozen=True, slots=True)
class CameraCalibration:
    """What the boards say of the camera.

    Attributes
    ----------
    bundle : Bundle
        The solution: lens, poses, boards, residuals and covariances.
    corners : tuple of BoardCorners
        Those it rests on, one set a view.
    outliers : tuple of CornerOutlier
        Those left out.
    halves_z : dict
        For each free unknown of the lens: difference between the calibrations of every second view, over its
        predicted sigma. Empty with too few views.
    """

    bundle: Bundle
    corners: tuple[BoardCorners, ...]
    outliers: tuple[CornerOutlier, ...]
    halves_z: dict[str, float]

    @property
    def camera_matrix(self) -> Array:
        """OpenCV's matrix, shape (3, 3), pixels."""
        return self.bundle.state.lens.camera_matrix

    @property
    def distortion(self) -> Array:
        """k1, k2, p1, p2, k3 of OpenCV's model."""
        return self.bundle.state.lens.distortion

    @property
    def sigma_scale(self) -> float:
        """By how much more than predicted the two halves of the views differ; at least 1."""
        z = np.array(list(self.halves_z.values()))
        return max(float(np.sqrt(np.mean(z**2))), 1.0) if len(z) else 1.0

    @property
    def intrinsics_sigma(self) -> dict[str, float]:
        """One standard deviation of each free unknown: f, aspect, cx, cy, k1, k2, p1, p2, k3.

        The prediction of the bundle, widened by `sigma_scale`: a sigma that is stated is one that was seen.
        """
        return {name: self.sigma_scale * sigma for name, sigma in self.bundle.lens_sigma.items()}

    @property
    def rotation(self) -> Array:
        """Sample to camera, shape (n_views, 3, 3)."""
        return self.bundle.state.rotation

    @property
    def translation(self) -> Array:
        """Sample to camera, mm, shape (n_views, 3)."""
        return self.bundle.state.translation

    @property
    def camera_position(self) -> Array:
        """Centre of projection of each view in the sample frame, mm, shape (n_views, 3)."""
        return np.asarray(-np.einsum("nji,nj->ni", self.rotation, self.translation))

    @property
    def residuals(self) -> tuple[Array, ...]:
        """Found minus predicted corners of each view, pixels, each of shape (n_corners, 2)."""
        return self.bundle.residuals

    @property
    def rms(self) -> float:
        """Root mean square of the residuals' lengths, pixels."""
        return float(np.sqrt(np.mean(np.concatenate([np.sum(r**2, axis=1) for r in self.residuals]))))

    @property
    def view_rms(self) -> Array:
        """The same for each view, shape (n_views,)."""
        return np.array([np.sqrt(np.mean(np.sum(r**2, axis=1))) for r in self.residuals])

    def registration_sigma(self, points: Array) -> Array:
        """Return how far each view may be shifted against the others on the sample plane, shape (n_views,).

        One standard deviation per axis, mm, RMS over `points` (n, 3) of the plane z = 0.
        """
        sigma = []
        for R, t, covariance in zip(self.rotation, self.translation, self.bundle.own_pose_covariance, strict=True):
            turned = points @ R.T
            _, by_point, _ = self.bundle.state.lens.project(turned + t)
            by_pose = np.concatenate([by_point @ -cross_matrix(turned), by_point], axis=2)
            # Pixels of the picture to mm on the plane.
            on_plane = np.linalg.solve((by_point @ R)[..., :2], by_pose)
            variance = np.einsum("nip,pq,niq->ni", on_plane, covariance, on_plane)
            sigma.append(np.sqrt(np.mean(variance)))
        return self.sigma_scale * np.array(sigma)


def usable_views(corners: Sequence[BoardCorners]) -> NDArray[np.bool_]:
    """Return which views show enough corners."""
    return np.array([len(c) >= MIN_CORNERS for c in corners])


def calibrate_camera(
    corners: Sequence[BoardCorners],
    image_size: tuple[int, int],
    layout: BoardLayout,
    focal_length_px: float | None = None,
    known: Lens | None = None,
) -> CameraCalibration:
    """Find lens, poses and board places that best explain the corners, outliers left out, all jointly.

    Parameters
    ----------
    corners : sequence of BoardCorners
        One a view, each with at least `MIN_CORNERS`.
    image_size : (int, int)
        Width, height.
    layout : BoardLayout
        Where the boards were to lie.
    focal_length_px : float or None
        To start from; None = found from the corners.
    known : Lens or None
        Intrinsics that are known and are not adjusted.

    Raises
    ------
    InvalidInputError
        If there are too few views.
    """
    if len(corners) < (1 if known else MIN_VIEWS):
        problem = Problem(
            "boards",
            f"{len(corners)} views show at least {MIN_CORNERS} board corners; at least {MIN_VIEWS} are needed. "
            "Check the boards in the rig file against the printed ones, focus and exposure.",
        )
        raise InvalidInputError("The camera cannot be calibrated.", [problem])
    lens = known or first_lens(corners, image_size, layout, focal_length_px)
    start = first_state(corners, lens, layout)
    free = Freedom(() if known else _supported_by(len(corners)), _to_measure(layout))
    kept, bundle = _without_outliers(corners, adjust(corners, start, free))
    bundle = _smallest(kept, bundle)
    return CameraCalibration(bundle, kept, _outliers(corners, bundle), _halves(kept, bundle))


def _to_measure(layout: BoardLayout) -> NDArray[np.bool_]:
    """Tell which boards' places are unknown; where none is known, the first is where it is."""
    unknown = ~layout.placed
    if unknown.all():
        unknown[:1] = False
    return unknown


def _supported_by(n_views: int) -> tuple[str, ...]:
    """Few views do not hold the weaker unknowns of the lens at all."""
    return LENS_NAMES if n_views >= 8 else ("f", "cx", "cy", "k1")


def _without_outliers(corners: Sequence[BoardCorners], bundle: Bundle) -> tuple[tuple[BoardCorners, ...], Bundle]:
    """Leave out what does not fit, and solve again, until nothing is left out."""
    kept = tuple(corners)
    for _ in range(5):
        fits = [normalised(c, r, bundle.noise) <= OUTLIER for c, r in zip(kept, bundle.residuals, strict=True)]
        if all(f.all() for f in fits) or any(f.sum() < MIN_CORNERS for f in fits):
            break
        kept = tuple(c.select(f) for c, f in zip(kept, fits, strict=True))
        bundle = adjust(kept, bundle.state, bundle.freedom)
    return kept, bundle


def normalised(corners: BoardCorners, residual: Array, noise: CornerNoise) -> Array:
    """Return the residuals' lengths over the sigma that is taken for each corner."""
    return np.asarray(np.linalg.norm(residual, axis=1) / np.sqrt(own_variance(corners) + noise.floor**2))


def _smallest(corners: Sequence[BoardCorners], bundle: Bundle) -> Bundle:
    """Take out what the corners do not need, the least needed first; then free the boards if they ask for it."""
    while True:
        free = bundle.freedom.lens
        groups = [group for group, before in _GROUPS if group[0] in free and before not in free]
        evidence = [(group, _evidence(bundle, group)) for group in groups]
        n = 2 * sum(len(c) for c in corners)
        weakest = min(evidence, key=lambda e: e[1] / len(e[0]), default=None)
        if weakest is None or weakest[1] > len(weakest[0]) * np.log(n):
            break
        bundle = adjust(corners, *drop(bundle, weakest[0]), bundle.noise)
    bundle = adjust(corners, bundle.state, bundle.freedom)
    return _boards_if_needed(corners, bundle)


def _evidence(bundle: Bundle, group: tuple[str, ...]) -> float:
    """Return how far a group of unknowns lies from nothing: x' C^-1 x."""
    at = [bundle.freedom.lens.index(name) for name in group]
    x = bundle.state.lens.values[[LENS_NAMES.index(name) for name in group]]
    x = x - np.array([1.0 if name == "aspect" else 0.0 for name in group])
    return float(x @ np.linalg.solve(bundle.covariance[np.ix_(at, at)], x))


def _boards_if_needed(corners: Sequence[BoardCorners], bundle: Bundle) -> Bundle:
    """Let the boards move against each other, if that takes off more than it costs [schwarz1978]."""
    n_boards = len(bundle.freedom.boards)
    if n_boards < 2 or bundle.freedom.boards.any():
        return bundle
    freer = adjust(corners, bundle.state, replace(bundle.freedom, boards=np.ones(n_boards, bool)))
    # On one scale of noise, that of the freer model, the displacements of the print included.
    gain = _chi2(corners, bundle, freer.noise) - _chi2(corners, freer, freer.noise)
    n = 2 * sum(len(c) for c in corners)
    return freer if gain > 6 * (n_boards - 1) * np.log(n) else bundle


def _chi2(corners: Sequence[BoardCorners], bundle: Bundle, noise: CornerNoise) -> float:
    of_print = np.sum(bundle.state.layout.displacement**2) / noise.print_sigma**2
    lengths = (normalised(c, r, noise) for c, r in zip(corners, bundle.residuals, strict=True))
    return float(of_print + sum(np.sum(length**2) for length in lengths))


def _outliers(corners: Sequence[BoardCorners], bundle: Bundle) -> tuple[CornerOutlier, ...]:
    found = []
    for v, c in enumerate(corners):
        in_sample = bundle.state.layout.points(c.corner)
        in_camera = in_sample @ bundle.state.rotation[v].T + bundle.state.translation[v]
        residual = c.image_points - bundle.state.lens.project(in_camera)[0]
        for k in np.flatnonzero(normalised(c, residual, bundle.noise) > OUTLIER):
            (x, y), (dx, dy) = c.image_points[k].tolist(), residual[k].tolist()
            found.append(CornerOutlier(v, int(bundle.state.layout.board[c.corner[k]]), (x, y), (dx, dy)))
    return tuple(found)


def _halves(corners: Sequence[BoardCorners], bundle: Bundle) -> dict[str, float]:
    """Calibrate every second view by itself: differences over their predicted sigmas."""
    if len(corners) < 2 * MIN_VIEWS or not bundle.freedom.lens:
        return {}
    held = Freedom(bundle.freedom.lens, np.zeros_like(bundle.freedom.boards))
    halves = []
    for first in (0, 1):
        of = np.arange(first, len(corners), 2)
        start = replace(bundle.state, rotation=bundle.state.rotation[of], translation=bundle.state.translation[of])
        halves.append(adjust([corners[int(v)] for v in of], start, held, bundle.noise))
    a, b = halves
    z = {}
    for name in bundle.freedom.lens:
        at = LENS_NAMES.index(name)
        sigma = np.hypot(a.lens_sigma[name], b.lens_sigma[name])
        z[name] = float((a.state.lens.values[at] - b.state.lens.values[at]) / sigma)
    return z


def views_of(camera: CameraCalibration) -> tuple[View, ...]:
    """Return where the camera stood in each view."""
    pairs = zip(camera.rotation, camera.translation, strict=True)
    return tuple(View(camera.camera_matrix, camera.distortion, R, t) for R, t in pairs)


def footprint_mm(camera: CameraCalibration) -> float:
    """Return the size of a pixel of the pictures on the sample, seen from straight ahead, mm."""
    return float(np.median(camera.translation[:, 2]) / camera.camera_matrix[0, 0])
