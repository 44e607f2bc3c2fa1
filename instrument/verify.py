"""Checks that a session is consistent, and every frame of it what the camera gave."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from instrument import layout
from instrument.digests import text_digest
from instrument.import_plan import ImportPlan
from instrument.json_text import parse_json
from instrument.layout import Status
from instrument.pose_check import PoseJournal, pose_problems
from instrument.session import Session
from instrument.session_reader import open_session_file
from instrument.structure import structure_problems
from instrument.validation import InvalidInputError, Problem


def verify_session(path: Path | str) -> Iterator[Problem]:
    """Yield everything that is wrong with a session; reads every frame of its complete poses, in this process.

    Raises
    ------
    InvalidInputError
        If `path` is no session at all.
    """
    with open_session_file(Path(path)) as file:
        problems = tuple(structure_problems(file))
        # Without its structure the content means nothing.
        yield from problems or (*content_problems(Path(path)), *_all_poses(file, Path(path)))


def content_problems(path: Path) -> Iterator[Problem]:
    """Yield what contradicts itself in a session of sound structure; reads no frame."""
    with Session(path) as session:
        for check in (plan_problems, _status_problems, _readback_problems):
            yield from _guarded(check(session))


def _all_poses(file: h5py.File, path: Path) -> Iterator[Problem]:
    journal = PoseJournal.read(file, path.stat().st_size)
    for i_pose in np.flatnonzero(journal.complete).tolist():
        yield from filter(None, pose_problems(file, journal, i_pose))


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
