"""What a calibration report shows of the session itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.session import Calibration
from instrument.session.records import Board
from instrument.session.session import Session

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SessionFacts:
    """Facts of a session, in the order of a calibration's views where they are of views.

    Attributes
    ----------
    title : str
    digest : str
        Of the session's plan and frames.
    image_size : (int, int)
        Width, height.
    n_complete : int
        Complete poses.
    boards : tuple of Board
    area_mm : tuple of float or None
    light_offset, light_offset_sigma : ndarray, shape (3,), or None
        As stated, camera frame, mm.
    seconds : ndarray, shape (n_views,)
        When each view was captured, since the start; NaN where no times were kept.
    tilt_deg, turn_deg : ndarray, shape (n_views,), or None
        Read-back of a stage that has those two axes.
    worst_preview : ndarray, shape (h, w), or None
        Small picture of the view whose corners fit worst.
    """

    title: str
    digest: str
    image_size: tuple[int, int]
    n_complete: int
    boards: tuple[Board, ...]
    area_mm: tuple[float, float] | None
    light_offset: Array | None
    light_offset_sigma: Array | None
    seconds: Array
    tilt_deg: Array | None
    turn_deg: Array | None
    worst_preview: NDArray[np.float32] | None


def facts_of(session: Session, calibration: Calibration) -> SessionFacts:
    """Read the facts of the session that a calibration came from."""
    i_pose, axes = calibration.i_pose, session.axis_values
    on_two_axes = {"tilt", "turn"} <= set(axes)
    return SessionFacts(
        title=session.title,
        digest=session.digest(),
        image_size=(session.camera.width, session.camera.height),
        n_complete=int(session.pose_complete.sum()),
        boards=session.nominal.boards,
        area_mm=session.nominal.area_mm,
        light_offset=session.nominal.light_offset_mm,
        light_offset_sigma=session.nominal.light_offset_sigma_mm,
        seconds=_seconds(session)[i_pose],
        tilt_deg=axes["tilt"][i_pose] if on_two_axes else None,
        turn_deg=axes["turn"][i_pose] if on_two_axes else None,
        worst_preview=_worst_preview(session, calibration),
    )


def _seconds(session: Session) -> Array:
    """Return the mean time of each pose's frames; an import has none, or the same for all."""
    return np.asarray(session.timestamps.mean(axis=1))


def _worst_preview(session: Session, calibration: Calibration) -> NDArray[np.float32] | None:
    if calibration.camera is None:
        return None
    return session.preview(int(calibration.i_pose[calibration.camera.view_rms.argmax()]))
