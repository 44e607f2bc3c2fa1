"""Reads from an interrupted session what is needed to resume it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from instrument.config.rig import RigConfig
from instrument.files.validation import InvalidInputError, raise_if_any
from instrument.session.layout import Status
from instrument.session.preview import Preview, previews_of
from instrument.session.session import Session
from instrument.session_tools.verify import plan_problems
from protocols.acquisition.sample_position import Landmark
from protocols.capture.run import Begun
from protocols.planning.plan import Plan
from protocols.planning.session_rig import rig_of


@dataclass(frozen=True, slots=True)
class BegunSession:
    """A captured session, whole or not.

    Attributes
    ----------
    path : Path
    rig : RigConfig
        As it stood then.
    plan : Plan
        As frozen then.
    begun : Begun
        How far it came.
    status : Status
    serial_numbers : dict of str to str
        Of its devices.
    n_events : int
        Lines that its journal holds.
    """

    path: Path
    rig: RigConfig
    plan: Plan
    begun: Begun
    status: Status
    serial_numbers: dict[str, str]
    n_events: int

    @classmethod
    def read(cls, path: Path) -> BegunSession:
        """Read a session.

        Raises
        ------
        InvalidInputError
            If the file is no session, was damaged, or its plan was changed.
        """
        with Session(path) as session:
            raise_if_any(f"{path} cannot be resumed", plan_problems(session))
            plan = Plan.from_json(session.plan_json)
            return cls(
                path=path,
                rig=rig_of(session),
                plan=plan,
                begun=_begun(session, plan),
                status=session.status,
                serial_numbers=session.serial_numbers,
                n_events=len(session.events),
            )

    @property
    def is_whole(self) -> bool:
        """Whether every pose is complete."""
        return len(self.begun.complete) == self.plan.n_poses


def _begun(session: Session, plan: Plan) -> Begun:
    dark, times, temperatures = session.dark, session.extra.flat_times, session.dark_temperatures
    return Begun(
        complete=frozenset(np.flatnonzero(session.pose_complete).tolist()),
        darkness=() if dark is None else tuple(float(frame.mean()) for frame in dark),
        dark_temperature=np.nan if dark is None or temperatures is None else float(temperatures.mean()),
        has_flats=bool(times.size and np.isfinite(times).all()),
        landmark=Landmark.of(session, plan.targets),
        previews=_previews(session),
    )


def _previews(session: Session) -> dict[int, Preview]:
    """Return the previews, none if one of them is damaged: they are only looked at, and no reason not to go on."""
    try:
        return previews_of(session)
    except InvalidInputError:
        return {}
