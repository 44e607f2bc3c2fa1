"""Chooses the one pose that would add most to those taken."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from instrument.config.protocol import ChosenConfig
from protocols.planning.planned_poses import PlannedPoses
from protocols.poses.choice import candidates
from protocols.poses.criterion import Array, Criterion
from protocols.poses.nominal_geometry import lens_and_light
from protocols.poses.patterns import Pose

ONE = ChosenConfig(count=1)
"""What the sample may be, and how far it may be tilted, as for poses that a protocol lets choose."""

NEAR_DEG = 10.0
"""A pose of the plan that sees the sample from so near tells nearly the same."""


@dataclass(frozen=True, slots=True)
class NextPose:
    """Where one more pose would help most.

    Attributes
    ----------
    position : dict of str to float
        Of each axis, degrees or mm.
    tilt_deg, azimuth_deg : float
        Of the line to the lens: from the plate's normal, and round it from x towards y of the sample.
    error_deg, error_without_deg : float
        Expected error of normals and BRDF with that pose and without (`protocols.poses.criterion`).
    i_pose : int or None
        The pose of the plan, still to come, that is as good as that.
    """

    position: dict[str, float]
    tilt_deg: float
    azimuth_deg: float
    error_deg: float
    error_without_deg: float
    i_pose: int | None

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name."""
        return asdict(self)

    def as_text(self) -> str:
        """Return it as an operator reads it."""
        gain = 1.0 - self.error_deg / self.error_without_deg
        at = ", ".join(f"{axis} {value:g}" for axis, value in self.position.items())
        planned = "" if self.i_pose is None else f"; pose {self.i_pose + 1} of the plan comes near it"
        return (
            f"one more pose would help most at tilt {self.tilt_deg:.0f} deg towards azimuth {self.azimuth_deg:.0f} deg "
            f"(stage: {at}): expected error {gain:.0%} less{planned}"
        )


def next_pose(planned: PlannedPoses, taken: Collection[int]) -> NextPose | None:
    """Return the pose within the stage's limits that lowers the expected error most; None if it cannot go anywhere.

    Parameters
    ----------
    planned : PlannedPoses
    taken : collection of int
        The poses that were taken.
    """
    already = [planned.positions[i_pose] for i_pose in sorted(taken)]
    possible = candidates(planned.rig, planned.axes, ONE, already)
    if not possible:
        return None
    criterion = Criterion.of(planned.rig, planned.axes, ONE, possible, already)
    errors = criterion.with_one_more([])
    best = possible[int(np.argmin(errors))]
    lens = _side(planned, best)
    return NextPose(
        position=dict(best),
        tilt_deg=float(np.rad2deg(np.arccos(np.clip(lens[2], -1.0, 1.0)))),
        azimuth_deg=float(np.rad2deg(np.arctan2(lens[1], lens[0])) % 360.0),
        error_deg=float(errors.min()),
        error_without_deg=criterion.value([]),
        i_pose=_near(planned, lens, set(range(planned.n_poses)) - set(taken)),
    )


def _side(planned: PlannedPoses, pose: Pose) -> Array:
    """Return the unit vector towards the lens at a pose, shape (3,)."""
    lens = lens_and_light(planned.rig, planned.axes, [pose])[0][0]
    return np.asarray(lens / np.linalg.norm(lens))


def _near(planned: PlannedPoses, side: Array, missing: Collection[int]) -> int | None:
    """Return the first of the missing poses that is nearest to a side, None if none is near."""
    lens = planned.views.lens
    cosines = lens @ side / np.linalg.norm(lens, axis=1)
    near = [i_pose for i_pose in sorted(missing) if cosines[i_pose] >= np.cos(np.deg2rad(NEAR_DEG))]
    return max(near, key=lambda i_pose: cosines[i_pose]) if near else None
