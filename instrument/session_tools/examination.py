"""Verifies a session that may be damaged in any way, and lists the poses that are good."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from instrument.files.child import ReaderEndedError, in_child
from instrument.files.probe import UNPACKED, ended_problem, look
from instrument.files.untrusted import HDF5_ERRORS
from instrument.files.validation import InvalidInputError, Problem
from instrument.session import layout
from instrument.session.reader import open_hdf5, refuse_foreign
from instrument.session.structure import structure_problems
from instrument.session_tools.truncated import missing_bytes, open_cut_short
from instrument.session_tools.verify import PoseJournal, content_problems, pose_problems

MAX_ENDINGS = 8
"""Child processes that one file may end; it is damaged enough then."""


@dataclass
class Examination:
    """What is known about a session.

    Attributes
    ----------
    path : Path
    n_poses : int
        0 if the frames cannot be found.
    good : list of int
        Poses that are complete and whose every frame is what was recorded.
    missing : list of int
        Poses that were not captured.
    problems : list of Problem
    """

    path: Path
    n_poses: int = 0
    good: list[int] = field(default_factory=list)
    missing: list[int] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "path": str(self.path),
            "n_poses": self.n_poses,
            "good_poses": self.good,
            "missing_poses": self.missing,
            "problems": [{"where": problem.where, "what": problem.what} for problem in self.problems],
        }

    def take(self, step: dict[str, Any]) -> None:
        """Add what a child process said."""
        self.n_poses = step.get("n_poses", self.n_poses)
        self.missing = step.get("missing", self.missing)
        self.good += step.get("good", [])
        self.problems += [Problem(*problem) for problem in step.get("problems", [])]


def examination(path: Path) -> Examination:
    """Verify a session in child processes, which it may end; it is never changed.

    Raises
    ------
    InvalidInputError
        If `path` is no session at all.
    """
    found, first, whole, at = Examination(path), 0, True, str(path)
    for _ in range(MAX_ENDINGS):
        begun = None
        try:
            for step in in_child("examine", path, first, int(whole)):
                if "refused" in step:
                    raise InvalidInputError(f"{path} is not a usable session", [Problem(*p) for p in step["refused"]])
                found.take(step)
                at, begun = step.get("at", at), step.get("pose", begun)
            return found
        except ReaderEndedError as error:
            found.problems.append(ended_problem(at, error))
        if begun is None and not whole:
            return found
        # The poses after the one that ended the child, or all of them, may be good nevertheless.
        first, whole = (first if begun is None else begun + 1), False
    return found


def examine(path: str, first: str, whole: str) -> Iterator[dict[str, Any]]:
    """Check a session from pose `first` on, and before it all else if `whole` is "1"; runs in the child."""
    yield from look(path, UNPACKED) if whole == "1" else ()
    try:
        file, problems = _open(Path(path))
        if whole == "1":
            refuse_foreign(file, Path(path))
    except InvalidInputError as error:
        yield {"refused": _plain(error.problems)}
        return
    with file:
        yield from _all_else(file, Path(path), problems) if whole == "1" else ()
        yield from _poses(file, Path(path).stat().st_size, int(first))


def _all_else(file: h5py.File, path: Path, problems: list[Problem]) -> Iterator[dict[str, Any]]:
    yield {"problems": _plain(problems)}
    structure = list(structure_problems(file))
    yield {"problems": _plain(structure if structure or problems else content_problems(path))}


def _open(path: Path) -> tuple[h5py.File, list[Problem]]:
    """Open a session, also one that is cut short; with that as a problem."""
    try:
        return open_hdf5(path), []
    except InvalidInputError:
        n_missing, size = missing_bytes(path) if path.is_file() else (0, 0)
        if not n_missing:
            raise
        with suppress(*HDF5_ERRORS):
            return open_cut_short(path, size), [Problem(str(path), _cut(n_missing, size))]
        raise


def _cut(n_missing: int, size: int) -> str:
    return f"is cut short: the last {n_missing} of {size} bytes are missing"


def _poses(file: h5py.File, n_there: int, first: int) -> Iterator[dict[str, Any]]:
    yield {"at": layout.JOURNAL}
    try:
        journal = PoseJournal.read(file, n_there)
    except InvalidInputError as error:
        yield {"problems": _plain(error.problems)}
        return
    yield {"n_poses": len(journal.complete), "missing": np.flatnonzero(~journal.complete).tolist()}
    for i_pose in np.flatnonzero(journal.complete).tolist():
        if i_pose >= first:
            yield {"at": f"{layout.IMAGES.path}[{i_pose}]", "pose": i_pose}
            bad = False
            for problem in pose_problems(file, journal, i_pose):
                bad = bad or problem is not None
                yield {"problems": _plain([problem]) if problem else []}
            yield {"good": [] if bad else [i_pose]}


def _plain(problems: Iterable[Problem]) -> list[tuple[str, str]]:
    return [(problem.where, problem.what) for problem in problems]
