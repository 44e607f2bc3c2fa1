"""Finds the registered stack that a result came from, which holds the samples that the result does not."""

from __future__ import annotations

import hashlib
from pathlib import Path

from analysis.point_samples import PointSamples, point_samples
from analysis.result import Result
from analysis.stack import Stack
from analysis.stack_file import is_stack, read_stack
from instrument.look import refuse_dangerous
from instrument.validation import InvalidInputError, Problem

TITLE = "The samples cannot be shown."


def source_stack(path: Path, result: Result, stack: Path | None = None) -> Stack:
    """Read the stack that a result came from, having made sure of it.

    Parameters
    ----------
    path : Path
        Of the result; the stack is looked for beside it.
    result : Result
    stack : Path, optional
        Where the stack lies instead.

    Raises
    ------
    InvalidInputError
        If it is not there, is not the one, or cannot be read.
    """
    name, digest = _stated(path, result)
    place = stack or path.parent / name
    if not place.is_file():
        raise _refused(place, f"is not there; put {name}, which {path.name} came from, beside it")
    refuse_dangerous(place)
    if not is_stack(place):
        what = "is the session; its registered stack was not kept. Write one with `halfangle calibrate"
        raise _refused(place, f"{what} {name} -o area.stack.h5` and reconstruct that")
    with place.open("rb") as file:
        if hashlib.file_digest(file, "sha256").hexdigest() != digest:
            raise _refused(place, f"is not the file that {path.name} came from, or has changed since; reconstruct it")
    return _checked(place, read_stack(place), result)


def _stated(path: Path, result: Result) -> tuple[str, str]:
    source = result.summary.get("source") if isinstance(result.summary, dict) else None
    name, digest = (source.get(key) if isinstance(source, dict) else None for key in ("file", "sha256"))
    if result.views is None or not isinstance(name, str) or not isinstance(digest, str) or not Path(name).name:
        what = "does not say which stack it came from and how it was fitted; reconstruct it with this version"
        raise _refused(path, what)
    # A result from elsewhere must not make us read files anywhere else.
    return Path(name).name, digest


def _checked(place: Path, stack: Stack, result: Result) -> Stack:
    assert result.views is not None
    expected = (len(result.views.light_power), result.grid.height, result.grid.width, result.fits.atom.shape[1])
    if stack.radiance.shape != expected:
        raise _refused(place, f"has radiances of shape {stack.radiance.shape}; the result is of {expected}")
    return stack


def _refused(place: Path, what: str) -> InvalidInputError:
    return InvalidInputError(TITLE, [Problem(str(place), what)])


class PointSource:
    """The samples of points of one result, whose stack is found and made sure of at the first.

    Parameters
    ----------
    path : Path
        Of the result.
    result : Result

    Attributes
    ----------
    path : Path
    result : Result
    """

    def __init__(self, path: Path, result: Result) -> None:
        self.path, self.result = path, result
        self._stack: Stack | None = None

    def at(self, row: int, column: int) -> PointSamples:
        """Return the samples of a pixel.

        Raises
        ------
        InvalidInputError
            If the stack is not there, is not the one, or cannot be read.
        IndexError
            If there is no such pixel.
        """
        if self._stack is None:
            self._stack = source_stack(self.path, self.result)
        return point_samples(self.result, self._stack, row, column)
