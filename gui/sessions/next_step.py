"""How a session is processed again: the command line for each step, and the new file that it makes."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import h5py

from instrument.files import derived_names
from instrument.files.probe import UNPACKED, refuse_dangerous
from instrument.files.untrusted import HDF5_ERRORS, text_attribute
from instrument.files.validation import InvalidInputError, Problem
from instrument.session.session import Session


class Reprocessing(NamedTuple):
    """A command line of `halfangle`, without that word, and what it makes."""

    arguments: tuple[str, ...]
    made: Path


def calibrating(session: Path) -> Reprocessing:
    """Calibrate a session, and register it if it shows boards.

    Raises
    ------
    InvalidInputError
        If it is no usable session.
    """
    refuse_dangerous(session, UNPACKED)
    with Session(session) as opened:
        has_boards = bool(opened.nominal.boards)
    stack, page, figures = derived_names.free(
        session, derived_names.STACK, derived_names.CALIBRATION_PAGE, derived_names.CALIBRATION
    )
    output = ("-o", str(stack)) if has_boards else ()
    arguments = ("calibrate", str(session), *output, "--report", str(page), "--json", str(figures))
    return Reprocessing(arguments, figures)


def reconstructing(source: Path) -> Reprocessing:
    """Reconstruct a stack, or a session: the newest stack that was made of its frames as they are, if there is one.

    Raises
    ------
    InvalidInputError
        If it is neither.
    """
    (made,) = derived_names.free(source, derived_names.RESULT)
    is_stack = source.name.endswith(derived_names.STACK)
    return Reprocessing(("reconstruct", str(source if is_stack else _stack_of(source)), "-o", str(made)), made)


def reporting(source: Path) -> Reprocessing:
    """Report a result, or the newest one of a session.

    Raises
    ------
    InvalidInputError
        If there is none.
    """
    results = (
        [source] if source.name.endswith(derived_names.RESULT) else derived_names.made(source, derived_names.RESULT)
    )
    if not results:
        raise InvalidInputError("There is nothing to report.", [Problem(str(source), "has no result; reconstruct it")])
    (made,) = derived_names.free(source, derived_names.REPORT)
    return Reprocessing(("report", str(results[0]), "-o", str(made)), made)


def _stack_of(session: Path) -> Path:
    refuse_dangerous(session, UNPACKED)
    with Session(session) as opened:
        digest = opened.digest()
    stacks = (stack for stack in derived_names.made(session, derived_names.STACK) if _session_digest(stack) == digest)
    return next(stacks, session)


def _session_digest(stack: Path) -> str | None:
    """Return of which frames a stack was made; None where it does not say, or cannot be read."""
    try:
        refuse_dangerous(stack, UNPACKED)
        with h5py.File(stack, "r") as file:
            return text_attribute(file["/entry"], "session_digest")
    except HDF5_ERRORS:
        return None
