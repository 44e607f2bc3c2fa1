"""Checks of a whole session in this process, for tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from instrument.files.validation import Problem
from instrument.session.reader import open_session_file
from instrument.session.structure import structure_problems
from instrument.session_tools.verify import PoseJournal, content_problems, pose_problems


def verify_session(path: Path | str) -> Iterator[Problem]:
    """Yield everything that is wrong with a session; reads every frame of its complete poses.

    Raises
    ------
    InvalidInputError
        If `path` is no session at all.
    """
    with open_session_file(Path(path)) as file:
        problems = tuple(structure_problems(file))
        # Without its structure the content means nothing.
        yield from problems or (*content_problems(Path(path)), *_all_poses(file, Path(path)))


def _all_poses(file: h5py.File, path: Path) -> Iterator[Problem]:
    journal = PoseJournal.read(file, path.stat().st_size)
    for i_pose in np.flatnonzero(journal.complete).tolist():
        yield from filter(None, pose_problems(file, journal, i_pose))
