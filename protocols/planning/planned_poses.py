"""The poses of a plan, and how each of them sees the sample as far as the rig file says."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from drivers.stage import AxisDescription
from instrument.config.rig import RigConfig
from instrument.rig.rig import Rig
from instrument.session.nominal_views import NominalViews
from instrument.session.preview import Preview
from protocols.planning.plan import Plan
from protocols.poses.nominal_geometry import nominal_views
from protocols.poses.patterns import Pose


@dataclass(frozen=True, eq=False)
class PlannedPoses:
    """The poses of a plan.

    Attributes
    ----------
    rig : RigConfig
        On which they are taken.
    axes : tuple of AxisDescription
        Of its stage, from the base to the sample.
    positions : tuple of mapping, length P
        By axis, degrees or mm.
    height, width : int
        Pixels of a raw frame.
    complete : frozenset of int
        Poses that were taken before.
    previews : mapping of int to Preview
        Of those, as far as they could be read.
    """

    rig: RigConfig
    axes: tuple[AxisDescription, ...]
    positions: tuple[Pose, ...]
    height: int
    width: int
    complete: frozenset[int] = frozenset()
    previews: Mapping[int, Preview] = field(default_factory=dict)

    @classmethod
    def of(
        cls, rig: Rig, plan: Plan, complete: Collection[int] = (), previews: Mapping[int, Preview] | None = None
    ) -> PlannedPoses:
        """Return the poses of a plan on a connected rig."""
        camera, axes = rig.camera.describe(), rig.stage.describe().axes
        size = camera.height, camera.width
        return cls(rig.config, axes, positions_of(plan), *size, frozenset(complete), previews or {})

    @property
    def n_poses(self) -> int:
        """P."""
        return len(self.positions)

    @cached_property
    def views(self) -> NominalViews:
        """How the camera sees the sample at each of them."""
        return nominal_views(self.rig, self.axes, self.positions, self.height, self.width)

    def name(self, i_pose: int) -> str:
        """Return what a pose is, e.g. ``"pose 7 of 24: tilt 30 deg, turn 120 deg"``."""
        units = {axis.name: "deg" if axis.kind == "rotation" else "mm" for axis in self.axes}
        places = (f"{axis} {value:g} {units.get(axis, '')}".rstrip() for axis, value in self.positions[i_pose].items())
        return f"pose {i_pose + 1} of {self.n_poses}: {', '.join(places)}"


def positions_of(plan: Plan) -> tuple[Pose, ...]:
    """Return the positions of a plan's poses by axis."""
    return tuple(plan.target(i_pose) for i_pose in range(plan.n_poses))
