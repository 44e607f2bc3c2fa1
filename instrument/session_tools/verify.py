"""Checks that a session is consistent, and every frame of it what the camera gave."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from instrument.files.digests import chain_digest, frame_digest, text_digest
from instrument.files.json_text import parse_json
from instrument.files.untrusted import HDF5_ERRORS, hard_linked, number_problems, storage_problems
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.session import layout
from instrument.session.import_plan import ImportPlan
from instrument.session.layout import Field, Status
from instrument.session.session import Session

_FIELDS = (layout.POSE_COMPLETE, layout.FRAME_OK, layout.COUNT_TIME, layout.FRAME_DIGEST, layout.POSE_DIGEST)


def content_problems(path: Path) -> Iterator[Problem]:
    """Yield what contradicts itself in a session of sound structure; reads no frame."""
    with Session(path) as session:
        for check in (plan_problems, _status_problems, _readback_problems):
            yield from _guarded(check(session))


def _guarded(problems: Iterator[Problem]) -> Iterator[Problem]:
    """Yield `problems`; what cannot be read is one of them."""
    try:
        yield from problems
    except InvalidInputError as error:
        yield from error.problems


def plan_problems(session: Session) -> Iterator[Problem]:
    """Yield what speaks against the plan of a session: changed, or not that of the frames."""
    if text_digest(session.plan_json) != session.plan_sha256:
        yield Problem(layout.PLAN_SHA256.path, "does not fit the plan: one of the two was changed")
        return
    try:
        plan = parse_json(session.plan_json)
        imported = ImportPlan.from_dict(plan) if session.is_imported else None
        times, n_poses = plan["exposure_times_s"], len(plan["poses"] if imported else plan["positions"])
    except (ValueError, LookupError, TypeError, AttributeError):
        yield Problem(layout.PLAN_JSON.path, "is not a plan")
        return
    if times != session.exposure_times.tolist():
        yield Problem(layout.COUNT_TIME.path, f"differs from the plan's {times} s")
    if n_poses != session.n_poses:
        yield Problem(layout.IMAGES.path, f"holds {session.n_poses} poses; the plan has {n_poses}")
    elif imported is not None:
        yield from _source_problems(session, imported)


def _source_problems(session: Session, plan: ImportPlan) -> Iterator[Problem]:
    """Yield where the frames of an import are not those of the pictures that its plan names."""
    ok, readback = session.frame_ok, session.exposure_readback
    for i_pose, sources in enumerate(plan.poses):
        times = [source.exposure_time_s for source in sources]
        if times != readback[i_pose][ok[i_pose]].tolist():
            files = ", ".join(source.file for source in sources)
            yield Problem(layout.EXPOSURE_READBACK.path, f"pose {i_pose} is not {files} of {times} s, as the plan says")


def _status_problems(session: Session) -> Iterator[Problem]:
    n_complete = int(session.pose_complete.sum())
    if session.status is Status.COMPLETE and n_complete < session.n_poses:
        what = f"says complete, but {session.n_poses - n_complete} of {session.n_poses} poses are missing"
        yield Problem(layout.STATUS.path, what)
    if session.status is Status.COMPLETE and not session.end_time:
        yield Problem(layout.END_TIME.path, "is empty in a complete session")


def _readback_problems(session: Session) -> Iterator[Problem]:
    whole, ok = session.pose_complete, session.frame_ok
    for i_pose in np.flatnonzero(whole & (ok & ~(session.exposure_readback > 0)).any(axis=1)):
        yield Problem(layout.EXPOSURE_READBACK.path, f"pose {i_pose} is marked complete without read-backs")


@dataclass(frozen=True, eq=False)
class PoseJournal:
    """What a session says of its frames.

    Attributes
    ----------
    complete : ndarray of bool, shape (P,)
    frame_ok : ndarray of bool, shape (P, E)
    exposure_times : ndarray, shape (E,)
        Seconds.
    frame_digest : ndarray of bytes, shape (P, E)
    pose_digest : ndarray of bytes, shape (P,)
    """

    complete: NDArray[np.bool_]
    frame_ok: NDArray[np.bool_]
    exposure_times: NDArray[np.float64]
    frame_digest: NDArray[np.bytes_]
    pose_digest: NDArray[np.bytes_]

    @classmethod
    def read(cls, file: h5py.File, n_bytes: int) -> Self:
        """Read it from an open session, of which the first `n_bytes` are there.

        Raises
        ------
        InvalidInputError
            If one of them is missing, mis-shaped or cannot be read.
        """
        try:
            raise_if_any("The poses cannot be checked.", _journal_problems(file))
            raise_if_any("The poses cannot be checked.", _lost(file, n_bytes))
            complete, ok, times, frame_digests, pose_digests = (file[field.path][()] for field in _FIELDS)
        except HDF5_ERRORS as error:
            if isinstance(error, InvalidInputError):
                raise
            problem = Problem(layout.JOURNAL, f"cannot be read: {error}")
            raise InvalidInputError("The poses cannot be checked.", [problem]) from error
        return cls(complete.astype(bool), ok.astype(bool), times, frame_digests, pose_digests)


def _journal_problems(file: h5py.File) -> Iterator[Problem]:
    dims: dict[str, int] = {}
    images = hard_linked(file, layout.IMAGES.path)
    if not isinstance(images, h5py.Dataset) or len(images.shape or ()) not in (4, 5):
        yield Problem(layout.IMAGES.path, "is missing, or no row of frames")
        return
    dims.update(P=images.shape[0], E=images.shape[1])
    yield from storage_problems(images, layout.IMAGES.path)
    for field in (layout.POSE_COMPLETE, layout.FRAME_OK, layout.COUNT_TIME):
        yield from number_problems(hard_linked(file, field.path), field.path, field.shape, dims)
    for field in (layout.FRAME_DIGEST, layout.POSE_DIGEST):
        yield from _digest_problems(hard_linked(file, field.path), field, dims)


def _lost(file: h5py.File, n_bytes: int) -> Iterator[Problem]:
    """Yield what lies beyond the end of a file that is cut short, where zeros would be read."""
    for field in _FIELDS:
        stored = file[field.path].id
        # None: in its header, or never written.
        if (stored.get_offset() or 0) + stored.get_storage_size() > n_bytes:
            yield Problem(field.path, "lies in the part that is missing, so that no pose can be checked")


def _digest_problems(found: Any, field: Field, dims: dict[str, int]) -> Iterator[Problem]:
    shape = tuple(dims[str(part)] for part in field.shape)
    if not isinstance(found, h5py.Dataset) or found.dtype != np.dtype(field.dtype) or found.shape != shape:
        yield Problem(field.path, f"is missing, or no texts of type {field.dtype} and shape {shape}")


def pose_problems(file: h5py.File, journal: PoseJournal, i_pose: int) -> Iterator[Problem | None]:
    """Yield what is wrong with the frames of one pose that is marked complete, and None after each frame."""
    digests = [bytes(text).decode("ascii", "replace") for text in journal.frame_digest[i_pose]]
    if chain_digest(digests) != bytes(journal.pose_digest[i_pose]).decode("ascii", "replace"):
        yield Problem(layout.FRAME_DIGEST.path, f"pose {i_pose}: the digests were changed")
    if not journal.frame_ok[i_pose].any():
        yield Problem(layout.FRAME_OK.path, f"pose {i_pose} is marked complete without a valid frame")
    for i_exposure in np.flatnonzero(journal.frame_ok[i_pose]).tolist():
        where = f"pose {i_pose}, exposure {i_exposure} ({journal.exposure_times[i_exposure]:g} s)"
        for what in _frame_problems(file, i_pose, i_exposure, digests[i_exposure]):
            yield Problem(layout.IMAGES.path, f"{where} {what}")
        yield None


def _frame_problems(file: h5py.File, i_pose: int, i_exposure: int, expected: str) -> Iterator[str]:
    try:
        found = frame_digest(file[layout.IMAGES.path][i_pose, i_exposure])
    except HDF5_ERRORS as error:
        yield f"cannot be read: {error}"
        return
    if found != expected:
        yield f"differs from what was recorded: {found} is not {expected}"
