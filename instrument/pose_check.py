"""Are the frames of a pose what was recorded? Asks only for frames and journal, so that it works where much is lost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from instrument import layout
from instrument.bounds import number_problems, storage_problems
from instrument.digests import chain_digest, frame_digest
from instrument.foreign import HDF5_ERRORS, hard_linked
from instrument.layout import Field
from instrument.validation import InvalidInputError, Problem, raise_if_any

_FIELDS = (layout.POSE_COMPLETE, layout.FRAME_OK, layout.COUNT_TIME, layout.FRAME_DIGEST, layout.POSE_DIGEST)


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
