"""Opens a session file and reads single datasets, with errors that name them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from instrument.files.untrusted import HDF5_ERRORS, hard_linked, text_attribute, why_not_open
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.session import layout
from instrument.session.layout import Field
from instrument.session.structure import structure_problems


class NotASessionError(InvalidInputError):
    """A sound file that holds something else than a session of this format."""


class SessionReader:
    """An open session file whose structure has been checked.

    Parameters
    ----------
    path : Path or str
        A session file; one that is still being recorded may be read too.

    Raises
    ------
    InvalidInputError
        With everything that is missing, mis-shaped, damaged or points out of the file.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.file = open_session_file(self.path)
        try:
            raise_if_any(f"{path} is not a usable session", structure_problems(self.file))
        except InvalidInputError:
            self.file.close()
            raise

    def close(self) -> None:
        """Close the file; safe to call twice."""
        self.file.close()

    def array(self, field: Field, at: Any = ()) -> NDArray[Any]:
        """Return the values of a field, or part of them."""
        with self.reading(field):
            return np.asarray(self.file[field.path][at])

    def scalar(self, field: Field) -> float:
        """Return the number of a field."""
        return float(self.array(field))

    def optional(self, field: Field) -> NDArray[Any] | None:
        """Return the values of an optional field, None if the session lacks it."""
        return self.array(field) if field.path in self.file else None

    def optional_scalar(self, field: Field) -> float | None:
        """Return the number of an optional field, None if the session lacks it."""
        return self.scalar(field) if field.path in self.file else None

    def array_or_empty(self, field: Field) -> NDArray[Any]:
        """Return the values of an optional field, none if the session lacks it."""
        return self.array(field) if field.path in self.file else np.zeros(0, field.dtype)

    def text(self, field: Field) -> str:
        """Return the text of a field."""
        with self.reading(field):
            return str(self.file[field.path].asstr()[()])

    def texts(self, field: Field) -> list[str]:
        """Return the texts of a field, in reading order."""
        with self.reading(field):
            return [text.decode() for text in self.file[field.path][()].ravel()]

    @contextmanager
    def reading(self, field: Field) -> Iterator[None]:
        """Turn what h5py raises on a damaged file into a problem at `field`."""
        try:
            yield
        except HDF5_ERRORS as error:
            problem = Problem(field.path, f"cannot be read: {error}")
            raise InvalidInputError(f"{self.path} is damaged", [problem]) from error


def open_session_file(path: Path) -> h5py.File:
    """Open a session to read; one that is still being recorded may be looked at, too.

    Raises
    ------
    InvalidInputError
        If `path` is missing, not HDF5, damaged, or holds something else than a session.
    """
    file = open_hdf5(path)
    try:
        refuse_foreign(file, path)
    except InvalidInputError:
        file.close()
        raise
    return file


def open_hdf5(path: Path) -> h5py.File:
    """Open a file as a session is opened, whatever it holds.

    Raises
    ------
    InvalidInputError
        If `path` is missing, not HDF5, or too damaged for that.
    """
    try:
        return _open(path)
    except HDF5_ERRORS as error:
        raise _unusable(path, why_not_open(path, error)) from None


def refuse_foreign(file: h5py.File, path: Path) -> None:
    """Raise `NotASessionError` if an open file holds something else, `InvalidInputError` if it cannot be told."""
    try:
        why = _why_foreign(file)
    except HDF5_ERRORS as error:
        raise _unusable(path, f"the file is damaged: {error}") from None
    if why:
        raise NotASessionError(f"{path} is not a usable session", [Problem(str(path), why)])


def _open(path: Path) -> h5py.File:
    try:
        # Without a lock: the writer holds one, and read-only shares may know none.
        return h5py.File(path, "r", locking=False)
    except OSError as error:
        try:
            # HDF5 lets one process open a file twice only with the same locking, here that of a recorder.
            return h5py.File(path, "r")
        except OSError:
            raise error from None


def _unusable(path: Path, why: str) -> InvalidInputError:
    return InvalidInputError(f"{path} is not a usable session", [Problem(str(path), why)])


def _why_foreign(file: h5py.File) -> str:
    entry = hard_linked(file, layout.ENTRY)
    version = text_attribute(entry, layout.SCHEMA_ATTRIBUTE) if isinstance(entry, h5py.Group) else None
    if version is None:
        return f"this HDF5 file is not of halfangle: {layout.ENTRY} has no {layout.SCHEMA_ATTRIBUTE}"
    holds = set(entry)
    if "instrument" not in holds:
        return f"this is not a session: {layout.ENTRY} holds {_listed(holds)}"
    major = layout.SCHEMA_VERSION.split(".")[0]
    if version.split(".", maxsplit=1)[0] != major:
        return f"the session has format {version}; this halfangle reads {major}.x"
    return ""


def _listed(names: set[str]) -> str:
    shown = sorted(names)[:8]
    return ", ".join(shown) + (" and more" if len(names) > len(shown) else "") or "nothing"
