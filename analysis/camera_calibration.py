"""Intrinsics of the camera and its pose in every view, from the corners of the marker boards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.boards import BoardCorners
from instrument.validation import InvalidInputError, Problem

Array = NDArray[np.float64]

MIN_CORNERS = 8
"""Fewest corners of a view that is used: a pose has six unknowns, and a few must be left to judge it by."""

MIN_VIEWS = 4
OUTLIER = 5.0
"""A corner whose residual exceeds this many times the typical one is left out."""


@dataclass(frozen=True, slots=True)
class CameraCalibration:
    """What the boards say of the camera.

    Attributes
    ----------
    camera_matrix : ndarray, shape (3, 3)
        Pixels.
    distortion : ndarray, shape (5,)
        k1, k2, p1, p2, k3 of OpenCV's model.
    intrinsics_sigma : dict
        One standard deviation of fx, fy, cx, cy, k1, k2, p1, p2.
    rotation : ndarray, shape (n_views, 3, 3)
        Sample to camera.
    translation : ndarray, shape (n_views, 3)
        Sample to camera, mm.
    position_sigma : ndarray, shape (n_views, 3)
        One standard deviation of the translation, mm.
    residuals : tuple of ndarray, each of shape (n_corners, 2)
        Found minus predicted corners of each view, pixels.
    rms : float
        Root mean square of the residuals' lengths, pixels.
    n_outliers : int
        Corners left out.
    """

    camera_matrix: Array
    distortion: Array
    intrinsics_sigma: dict[str, float]
    rotation: Array
    translation: Array
    position_sigma: Array
    residuals: tuple[Array, ...]
    rms: float
    n_outliers: int

    @property
    def camera_position(self) -> Array:
        """Centre of projection of each view in the sample frame, mm, shape (n_views, 3)."""
        return np.asarray(-np.einsum("nji,nj->ni", self.rotation, self.translation))


def usable_views(corners: Sequence[BoardCorners]) -> NDArray[np.bool_]:
    """Return which views show enough corners."""
    return np.array([len(c) >= MIN_CORNERS for c in corners])


def calibrate_camera(
    corners: Sequence[BoardCorners], image_size: tuple[int, int], focal_length_px: float
) -> CameraCalibration:
    """Find intrinsics and poses that best explain the corners, outliers left out, all jointly.

    Levenberg-Marquardt of OpenCV on the squared reprojection error [zhang2000]; k3 stays zero, since
    free it lets the principal point wander at the fields of view used here.

    Parameters
    ----------
    corners : sequence of BoardCorners
        One a view, each with at least `MIN_CORNERS`.
    image_size : (int, int)
        Width, height.
    focal_length_px : float
        To start from.

    Raises
    ------
    InvalidInputError
        If there are too few views.
    """
    if len(corners) < MIN_VIEWS:
        problem = Problem(
            "boards",
            f"{len(corners)} views show at least {MIN_CORNERS} board corners; at least {MIN_VIEWS} are needed. "
            "Check the boards in the rig file against the printed ones, focus and exposure.",
        )
        raise InvalidInputError("The camera cannot be calibrated.", [problem])
    solution = _solve(corners, image_size, focal_length_px)
    lengths = np.concatenate([np.linalg.norm(r, axis=1) for r in solution.residuals])
    limit = OUTLIER * max(float(np.median(lengths)), 1e-3)
    kept = [c.select(np.linalg.norm(r, axis=1) <= limit) for c, r in zip(corners, solution.residuals, strict=True)]
    n_outliers = int(np.count_nonzero(lengths > limit))
    if n_outliers == 0 or not usable_views(kept).all():
        return solution
    return _solve(kept, image_size, focal_length_px, n_outliers)


def _solve(
    corners: Sequence[BoardCorners], image_size: tuple[int, int], focal_length_px: float, n_outliers: int = 0
) -> CameraCalibration:
    width, height = image_size
    guess = np.array(
        [[focal_length_px, 0, (width - 1) / 2], [0, focal_length_px, (height - 1) / 2], [0, 0, 1]], np.float64
    )
    rms, matrix, distortion, rvecs, tvecs, sigma_in, sigma_ex, _ = cv2.calibrateCameraExtended(
        [c.object_points.astype(np.float32) for c in corners],
        [c.image_points.astype(np.float32) for c in corners],
        image_size,
        guess,
        np.zeros(5),
        flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3,
    )
    residuals = tuple(
        c.image_points - cv2.projectPoints(c.object_points, r, t, matrix, distortion)[0].reshape(-1, 2)
        for c, r, t in zip(corners, rvecs, tvecs, strict=True)
    )
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
    return CameraCalibration(
        camera_matrix=np.asarray(matrix, np.float64),
        distortion=np.asarray(distortion, np.float64).ravel()[:5],
        intrinsics_sigma={n: float(s) for n, s in zip(names, np.ravel(sigma_in), strict=False)},
        rotation=np.stack([cv2.Rodrigues(r)[0] for r in rvecs]),
        translation=np.stack([np.ravel(t) for t in tvecs]),
        position_sigma=np.asarray(sigma_ex, np.float64).reshape(len(corners), 6)[:, 3:],
        residuals=residuals,
        rms=float(rms),
        n_outliers=n_outliers,
    )
