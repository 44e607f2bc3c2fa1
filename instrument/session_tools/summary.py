"""Summarises a session, for lists and for other programs."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from instrument.files.child import ReaderEndedError, in_child
from instrument.files.probe import UNPACKED, ended_problem, look
from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import NO_LOCKS
from instrument.session.layout import Status
from instrument.session.reader import NotASessionError
from instrument.session.records import CameraRecord
from instrument.session.session import Session

BATCH = 500
"""Files for one child process: a command line has an end."""

DAMAGED, OTHER = "damaged", "other"
"""States of files beside those of a session (`layout.Status`): one that cannot be read, one that is no session."""


def summarise(path: Path) -> dict[str, Any]:
    """Return what a session holds, as plain values for JSON.

    Raises
    ------
    InvalidInputError
        If `path` is not a usable session, or ends the process that reads it.
    """
    (row,) = summarise_all([path])
    if "problems" in row:
        raise InvalidInputError(f"{path} is not a usable session", [Problem(*problem) for problem in row["problems"]])
    return row


def summarise_all(paths: list[Path]) -> list[dict[str, Any]]:
    """Return the summary of each session; of other files path, state and problems.

    They are read in a child process, and in another one after each file that ended it.
    """
    rows: list[dict[str, Any]] = []
    while len(rows) < len(paths):
        waiting, at = paths[len(rows) : len(rows) + BATCH], ""
        try:
            for step in in_child("summaries", *waiting):
                at = step.get("at", at)
                rows += [step["row"]] if "row" in step else []
        except ReaderEndedError as error:
            rows.append(_unusable(paths[len(rows)], DAMAGED, [ended_problem(at, error)]))
    return rows


def summaries(*paths: str) -> Iterator[dict[str, Any]]:
    """Yield a row for each file; runs in the child."""
    for path in paths:
        yield from look(path, UNPACKED)
        yield {"row": _row(Path(path))}


def _row(path: Path) -> dict[str, Any]:
    try:
        return summarise_here(path)
    except NotASessionError as error:
        return _unusable(path, OTHER, error.problems)
    except InvalidInputError as error:
        return _unusable(path, DAMAGED, error.problems)


def summarise_here(path: Path) -> dict[str, Any]:
    """Return what a session holds, read in this process: for a file that has been looked at.

    Raises
    ------
    InvalidInputError
        If `path` is not a usable session.
    """
    with Session(path) as session:
        return _summary(session)


def _unusable(path: Path, state: str, problems: list[Problem] | tuple[Problem, ...]) -> dict[str, Any]:
    return {"path": str(path), "state": state, "problems": [(problem.where, problem.what) for problem in problems]}


def _summary(session: Session) -> dict[str, Any]:
    camera, complete = session.camera, session.pose_complete
    clipped = np.where(complete[:, None], session.saturated_fraction, np.nan)
    return {
        "path": str(session.path),
        "title": session.title,
        "sample": session.sample,
        "state": _state(session),
        "status": session.status.value,
        "n_poses": session.n_poses,
        "n_complete": int(complete.sum()),
        "exposure_times_s": session.exposure_times.tolist(),
        "largest_saturated_fraction": _largest(clipped),
        "has_darks": session.has_darks,
        "camera": _name(camera),
        "frame_size": [camera.width, camera.height],
        "bayer_pattern": camera.bayer_pattern,
        "n_boards": len(session.nominal.boards),
        "start_time": session.start_time,
        "end_time": session.end_time,
        "bytes": session.path.stat().st_size,
        "plan_sha256": session.plan_sha256,
        "digest": session.digest(),
    }


def _state(session: Session) -> str:
    """Return the status, except that a capture which was killed still says that it is recording."""
    if session.status is Status.RECORDING and not is_written(session.path):
        return Status.INTERRUPTED.value
    return session.status.value


def is_written(path: Path) -> bool:
    """Return whether another process has the file open to write, for HDF5 locks it then.

    Where the file system has no locks nobody can tell; who sets HDF5_USE_FILE_LOCKING=FALSE there answers for it.
    """
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
    return False


def _name(camera: CameraRecord) -> str:
    name = f"{camera.make} {camera.model}".strip() or "unknown"
    return f"{name}, serial number {camera.serial_number}" if camera.serial_number else name


def _largest(clipped: np.ndarray[Any, np.dtype[np.float64]]) -> list[float | None]:
    """Return the largest value of each column, None where no complete pose has a frame."""
    columns = (column[np.isfinite(column)] for column in clipped.T)
    return [float(column.max()) if column.size else None for column in columns]
