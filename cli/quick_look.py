"""What `halfangle session quick-look` finds, prints and draws."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.quick_look.quick_look import QuickLook
from analysis.quick_look.quick_look import quick_look as quick_look_of
from instrument.files.probe import refuse_dangerous
from instrument.files.validation import LINE_BREAK, InvalidInputError, Problem, printable
from instrument.session.session import Session
from protocols.planning.next_pose import NextPose, next_pose
from protocols.planning.session_rig import planned_poses_of


@dataclass(frozen=True)
class Found:
    """A quick look at a session.

    Attributes
    ----------
    path : Path
    n_poses : int
        Of the plan.
    look : QuickLook
    next_pose : NextPose or None
    """

    path: Path
    n_poses: int
    look: QuickLook
    next_pose: NextPose | None

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        best = None if self.next_pose is None else self.next_pose.as_dict()
        return {"session": str(self.path), "n_poses": self.n_poses, **self.look.as_dict(), "next_pose": best}


def look_at(path: Path) -> Found:
    """Look at a session.

    Raises
    ------
    InvalidInputError
        If it is none, or has no nominal poses.
    """
    refuse_dangerous(path)
    with Session(path) as session:
        planned = planned_poses_of(session)
    look = quick_look_of(planned.views, planned.previews)
    return Found(path, planned.n_poses, look, next_pose(planned, look.used))


def write_picture(found: Found, path: Path) -> None:
    """Write the picture of a quick look.

    Raises
    ------
    InvalidInputError
        If there are no normals to show.
    """
    from analysis.quick_look.figure import quick_figure
    from instrument.files.whole_file import write_whole

    if found.look.problems:
        problems = [Problem(str(found.path), what) for what in found.look.problems]
        raise InvalidInputError(f"There are no normals to draw; {path} was not written.", problems)
    write_whole(path, quick_figure(found.look))


def quick_text(found: Found) -> str:
    """Return lines for the operator."""
    look = found.look
    lines = [f"{found.path}: {len(look.used)} of {found.n_poses} poses", *_normals(look)]
    if look.dark:
        lines.append(f"  left out   poses {', '.join(map(str, look.dark))}, whose pictures are black")
    if look.coverage is not None:
        lines += [f"  coverage   {text}" for text in look.coverage.advice() or ("no half angle lacks views",)]
    if found.next_pose is not None:
        lines.append(f"  next       {found.next_pose.as_text()}")
    # Names of axes come from the session, whoever made it.
    return printable("\n".join(lines), keep=LINE_BREAK)


def _normals(look: QuickLook) -> list[str]:
    if look.problems:
        return [f"  normals    none yet: {what}" for what in look.problems]
    n_solved = np.count_nonzero(np.isfinite(look.sigma_deg))
    return [
        f"  normals    of {n_solved} cells of {look.pitch:.2g} mm: {look.median_sigma_deg:.1f} deg by the scatter "
        "of the views; nominal places add two or more"
    ]
