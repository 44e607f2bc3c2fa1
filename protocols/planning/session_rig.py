"""The rig and the poses of a session, as they stood when it was captured."""

from __future__ import annotations

import numpy as np
from pydantic import ValidationError

from drivers.limits import Limits
from drivers.stage import AxisDescription
from instrument.config.rig import RigConfig
from instrument.files.validation import InvalidInputError, Problem
from instrument.session.preview import previews_of
from instrument.session.records import AxisRecord
from instrument.session.session import Session
from protocols.planning.plan import Plan
from protocols.planning.planned_poses import PlannedPoses, positions_of


def rig_of(session: Session) -> RigConfig:
    """Return the rig of a captured session.

    Raises
    ------
    InvalidInputError
        If what the session holds is no rig of this release.
    """
    try:
        rig = RigConfig.model_validate_json(session.rig_json, strict=True)
    except ValidationError as error:
        problem = Problem("/entry/process_capture/rig_values", f"is no rig of this release: {error}")
        raise InvalidInputError(f"{session.path} cannot be used", [problem]) from None
    rig.remember(session.rig_text)
    return rig


def planned_poses_of(session: Session) -> PlannedPoses:
    """Return the poses of a captured session, whole or interrupted, with what its rig file says of them.

    Raises
    ------
    InvalidInputError
        If nothing says where lens and light stood, as for pictures from elsewhere.
    """
    if session.is_imported:
        what = "was imported: no rig says where lens and light stood. Find out by halfangle calibrate"
        raise InvalidInputError(f"{session.path} has no nominal poses", [Problem(str(session.path), what)])
    return PlannedPoses(
        rig=rig_of(session),
        axes=tuple(_description(axis) for axis in session.axes),
        positions=positions_of(Plan.from_json(session.plan_json)),
        height=session.camera.height,
        width=session.camera.width,
        complete=frozenset(np.flatnonzero(session.pose_complete).tolist()),
        previews=previews_of(session),
    )


def _description(axis: AxisRecord) -> AxisDescription:
    unit = "deg" if axis.kind == "rotation" else "mm"
    return AxisDescription(axis.name, axis.kind, Limits(axis.low, axis.high, unit), axis.tolerance, axis.vector)
