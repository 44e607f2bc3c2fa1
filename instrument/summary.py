"""A session in a few words, for lists and for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from instrument.records import CameraRecord
from instrument.session import Session
from instrument.validation import InvalidInputError


def summarise(path: Path) -> dict[str, Any]:
    """Return what a session holds, as plain values for JSON.

    Raises
    ------
    InvalidInputError
        If `path` is not a usable session.
    """
    with Session(path) as session:
        camera, complete = session.camera, session.pose_complete
        clipped = np.where(complete[:, None], session.saturated_fraction, np.nan)
        return {
            "path": str(path),
            "title": session.title,
            "sample": session.sample,
            "status": session.status.value,
            "n_poses": session.n_poses,
            "n_complete": int(complete.sum()),
            "exposure_times_s": session.exposure_times.tolist(),
            "largest_saturated_fraction": _largest(clipped),
            "has_darks": session.has_darks,
            "camera": _name(camera),
            "frame_size": [camera.width, camera.height],
            "bayer_pattern": camera.bayer_pattern,
            "n_boards": len(session.boards),
            "start_time": session.start_time,
            "end_time": session.end_time,
            "bytes": path.stat().st_size,
            "plan_sha256": session.plan_sha256,
            "digest": session.digest(),
        }


def summarise_all(folder: Path) -> list[dict[str, Any]]:
    """Return the summaries of the sessions in `folder`, by name; other files are left out."""
    return [summary for path in sorted(folder.glob("*.h5")) for summary in _summary_or_none(path)]


def _summary_or_none(path: Path) -> list[dict[str, Any]]:
    try:
        return [summarise(path)]
    except InvalidInputError:
        return []


def _name(camera: CameraRecord) -> str:
    name = f"{camera.make} {camera.model}".strip() or "unknown"
    return f"{name}, serial number {camera.serial_number}" if camera.serial_number else name


def _largest(clipped: np.ndarray[Any, np.dtype[np.float64]]) -> list[float | None]:
    """Return the largest value of each column, None where no complete pose has a frame."""
    columns = (column[np.isfinite(column)] for column in clipped.T)
    return [float(column.max()) if column.size else None for column in columns]
