"""The reference patch: the white of the marker boards, in every frame, tells how the light drifts."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription
from drivers.stage import StageDescription
from instrument.config.boards import Rectangle
from instrument.config.rig import RigConfig
from protocols.poses.nominal_geometry import LAB_FROM_CAMERA, lab_from_sample

Array = NDArray[np.float64]

# White is what is brighter than most of a board with its margin: half of it is ink, and of the rest part is marker.
_WHITE_QUANTILE = 0.9

# Of a square, on each side: the paper round a board is white too.
_MARGIN = 0.5


class ReferencePatch:
    """Reads the white of the boards where a rig's nominal geometry says that they lie.

    The brightness is that of a sheet that faces lens and light at the working distance: what tilt and distance take
    from it by Lambert's law is given back, so that the values of all poses make one curve.

    Parameters
    ----------
    rig : RigConfig
        Boards that are placed, working distance, focal length.
    camera : CameraDescription
    stage : StageDescription
    """

    def __init__(self, rig: RigConfig, camera: CameraDescription, stage: StageDescription) -> None:
        self._rig, self._camera, self._stage = rig, camera, stage
        self._rectangles = [
            _grown(board.rectangle, _MARGIN * board.square_mm) for board in rig.boards if board.rectangle is not None
        ]

    def brightness(self, counts: NDArray[np.uint16], exposure_times: Array, positions: Mapping[str, float]) -> float:
        """Return the brightness of the patch in one bracket, counts per second; NaN where no board is in sight.

        Parameters
        ----------
        counts : ndarray of uint16, shape (K, H, W)
            Frames, exposure times ascending.
        exposure_times : ndarray, shape (K,)
            Seconds.
        positions : mapping of str to float
            Of the stage's axes.
        """
        R, t = lab_from_sample(self._stage.axes, positions)
        values = [self._board(counts, exposure_times, R, t, rectangle) for rectangle in self._rectangles]
        seen = [value for value in values if math.isfinite(value)]
        return float(np.mean(seen)) if seen else math.nan

    def _board(self, counts: NDArray[np.uint16], times: Array, R: Array, t: Array, rectangle: Rectangle) -> float:
        left, bottom, right, top = rectangle
        corners = np.array([(left, bottom, 0.0), (right, bottom, 0.0), (right, top, 0.0), (left, top, 0.0)])
        columns, rows = self._pixels(corners @ R.T + t)
        height, width = counts.shape[1:]
        if min(columns) < 0 or min(rows) < 0 or max(columns) >= width - 1 or max(rows) >= height - 1:
            return math.nan
        window = counts[:, int(min(rows)) : int(max(rows)) + 1, int(min(columns)) : int(max(columns)) + 1]
        centre = R @ np.array([(left + right) / 2, (bottom + top) / 2, 0.0]) + t
        return self._white(window, times) / self._share(centre, R[:, 2])

    def _pixels(self, points: Array) -> tuple[Array, Array]:
        """Project points (n, 3) of the lab frame, whose origin lies at the working distance; z towards the lens."""
        f, height, width = self._rig.camera.focal_length_px, self._camera.height, self._camera.width
        away = self._rig.geometry.working_distance_mm - points[:, 2]
        return (width - 1) / 2 + f * points[:, 0] / away, (height - 1) / 2 - f * points[:, 1] / away

    def _white(self, window: NDArray[np.uint16], times: Array) -> float:
        """Return the white's counts per second in the longest exposure that does not clip it."""
        for counts, time in zip(window[::-1], times[::-1], strict=True):
            white = float(np.quantile(counts, _WHITE_QUANTILE))
            if white < 0.95 * self._camera.saturation_level:
                return (white - self._camera.black_level) / float(time)
        return math.nan

    def _share(self, point: Array, normal: Array) -> float:
        """Return cos(theta) / r^2 at `point`, relative to a sheet at the origin that faces the light."""
        distance = self._rig.geometry.working_distance_mm
        light = np.array([0.0, 0.0, distance]) + LAB_FROM_CAMERA @ np.array(self._rig.light.offset_mm)
        to_light = light - point
        r = float(np.linalg.norm(to_light))
        return max(float(to_light @ normal) / r, 1e-3) * (distance / r) ** 2


def _grown(rectangle: Rectangle, by: float) -> Rectangle:
    left, bottom, right, top = rectangle
    return left - by, bottom - by, right + by, top + by
