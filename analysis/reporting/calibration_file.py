"""A calibration as `halfangle calibrate --json` keeps it, read back to be looked at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.session import Calibration
from analysis.registration.coverage import Coverage
from analysis.reporting.checks import Check, Status
from instrument.files import derived_names
from instrument.files.json_text import parse_json
from instrument.files.validation import InvalidInputError, Problem

Array = NDArray[np.float64]

MAX_BYTES = 2**28
"""A thousand views of a thousand corners take half of it."""


@dataclass(frozen=True, slots=True)
class SavedView:
    """One view.

    Attributes
    ----------
    i_pose : int
    camera_position : ndarray, shape (3,)
        Sample frame, mm.
    rms : float
        Root mean square of the residuals' lengths, pixels.
    n_left_out : int
        Corners that are not among the others.
    corners, residuals : ndarray, shape (n, 2)
        Columns and rows, and found minus predicted, pixels.
    """

    i_pose: int
    camera_position: Array
    rms: float
    n_left_out: int
    corners: Array
    residuals: Array

    @property
    def tilt(self) -> float:
        """Angle of the camera from the normal of the sample, rad."""
        x, y, z = self.camera_position
        return float(np.arctan2(np.hypot(x, y), z))

    @property
    def azimuth(self) -> float:
        """Direction of the camera round that normal, rad, counted from the right to the top."""
        return float(np.arctan2(self.camera_position[1], self.camera_position[0]))


@dataclass(frozen=True, slots=True)
class SavedCalibration:
    """A calibration of a session.

    Attributes
    ----------
    session_digest : str
        Of the plan and the frames that it was made from.
    image_size : (int, int)
        Width, height.
    checks : tuple of Check
        The worst first.
    views : tuple of SavedView
        Empty without boards.
    coverage : Coverage or None
        None without an area.
    """

    session_digest: str
    image_size: tuple[int, int]
    checks: tuple[Check, ...]
    views: tuple[SavedView, ...]
    coverage: Coverage | None


def read_calibration(path: Path) -> SavedCalibration:
    """Read what `halfangle calibrate --json` wrote.

    Raises
    ------
    InvalidInputError
        If it cannot be read, or is something else.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"it has more than {MAX_BYTES // 2**20} MiB")
        return _calibration(parse_json(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        what = f"is not what `halfangle calibrate --json` writes ({type(error).__name__}: {error}). Calibrate again"
        raise InvalidInputError("The calibration cannot be read.", [Problem(str(path), what)]) from None


def calibration_beside(session: Path, digest: str) -> SavedCalibration | None:
    """Return the newest calibration beside a session that was made of its frames as they are; None if there is none.

    Parameters
    ----------
    session : Path
    digest : str
        Of the session now.

    Raises
    ------
    InvalidInputError
        If one of them cannot be read.
    """
    for path in derived_names.made(session, derived_names.CALIBRATION):
        found = read_calibration(path)
        if found.session_digest == digest:
            return found
    return None


def _calibration(values: dict[str, Any]) -> SavedCalibration:
    width, height = values["image_size_px"]
    return SavedCalibration(
        session_digest=str(values["session_digest"]),
        image_size=(int(width), int(height)),
        checks=tuple(_check(value) for value in values["checks"]),
        views=tuple(_view(value) for value in values["views"]),
        coverage=None if values["coverage"] is None else _coverage(values["coverage"]),
    )


def _check(value: dict[str, Any]) -> Check:
    texts = {name: str(value[name]) for name in ("name", "number", "threshold", "remedy")}
    number = float("nan") if value["value"] is None else float(value["value"])
    return Check(status=Status(value["status"]), value=number, **texts)


def _view(value: dict[str, Any]) -> SavedView:
    corners, residuals = (_finite(value[name], (-1, 2)) for name in ("corners_px", "residuals_px"))
    if len(corners) != len(residuals):
        raise ValueError(f"pose {value['pose']} has {len(corners)} corners and {len(residuals)} residuals")
    position = _finite(value["camera_position_mm"], (3,))
    return SavedView(int(value["pose"]), position, float(value["rms_px"]), int(value["n_left_out"]), corners, residuals)


def _coverage(value: dict[str, Any]) -> Coverage:
    edges = _finite(value["theta_h_edges_deg"], (-1,))
    n_bins = (len(edges) - 1,)
    halves, slopes = (
        {str(name): _finite(views, n_bins) for name, views in value[key].items()}
        for key in ("views_on_half", "views_for_slopes_facing")
    )
    all_over = _finite(value["views_all_over"], n_bins)
    return Coverage(edges, all_over, halves, slopes, float(value["smallest_deg"]), float(value["largest_deg"]))


def _finite(values: Any, shape: tuple[int, ...]) -> Array:
    array = np.array(values, np.float64).reshape(shape)
    if not np.isfinite(array).all():
        raise ValueError("there are numbers that are not finite")
    return array


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
