"""Each view of a calibration in plain values: where the camera stood, and what is left of the corners."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from analysis.session_calibration import Calibration


def view_figures(calibration: Calibration) -> Iterator[dict[str, Any]]:
    """Yield each view as JSON has it: pose, place in the sample frame in mm, corners and residuals in pixels.

    Residuals are found minus predicted; corners that were left out are not among them.
    """
    camera = calibration.camera
    if camera is None:
        return
    for v, i_pose in enumerate(calibration.i_pose):
        yield {
            "pose": int(i_pose),
            "camera_position_mm": np.round(camera.camera_position[v], 4).tolist(),
            "rms_px": float(camera.view_rms[v]),
            "n_left_out": sum(outlier.view == v for outlier in camera.outliers),
            "corners_px": np.round(camera.corners[v].image_points, 3).tolist(),
            "residuals_px": np.round(camera.residuals[v], 5).tolist(),
        }
