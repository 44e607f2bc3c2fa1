"""Refuses a capture that cannot end well, with every reason, before anything moves or lights."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from drivers.errors import DeviceLimitError
from drivers.limits import Limits
from instrument.files.validation import Problem
from instrument.rig.rig import Rig
from instrument.session.creation import InsufficientSpaceError, check_space
from protocols.plan import Plan


def preflight_problems(rig: Rig, plan: Plan) -> Iterator[Problem]:
    """Yield what the connected devices cannot do of a plan."""
    yield from _axis_problems(rig, plan)
    yield from _size_problems(rig)
    limits = rig.camera.describe().exposure_time_limits
    for exposure_time in plan.exposure_times:
        remedy = "Drop that step from the bracket or change the aperture."
        yield from _limit_problem("bracket.exposure_times_s", limits, exposure_time, remedy)
    if plan.flats:
        yield from _limit_problem("flats.exposure_time_s", limits, plan.flat_time, "Choose another one.")
    level = rig.config.light.level
    yield from _limit_problem("light.level", rig.light.describe().level_limits, level, "Change light.level.")


def space_problems(rig: Rig, plan: Plan, path: Path) -> Iterator[Problem]:
    """Yield whether the disk is too small for the session `path` of a plan."""
    camera = rig.camera.describe()
    try:
        check_space(path, plan.bytes(camera.height, camera.width))
    except InsufficientSpaceError as error:
        yield Problem(str(path), str(error.strerror))


def _size_problems(rig: Rig) -> Iterator[Problem]:
    camera, stated = rig.camera.describe(), rig.config.camera
    if (camera.width, camera.height) != (stated.width, stated.height):
        what = f"the camera delivers {camera.width} x {camera.height} pixels; [camera] says"
        yield Problem("camera.width", f"{what} {stated.width} x {stated.height}. Correct the rig file or the region.")


def _axis_problems(rig: Rig, plan: Plan) -> Iterator[Problem]:
    axes = {axis.name: axis for axis in rig.stage.describe().axes}
    for name, targets in plan.targets.items():
        if name not in axes:
            yield Problem(f"axis {name!r}", f"the stage has no such axis; it has {', '.join(axes)}")
            continue
        for i_pose, target in enumerate(targets):
            where = f"pose {i_pose}, axis {name!r}"
            yield from _limit_problem(where, axes[name].soft_limits, target, "Leave that pose out.")


def _limit_problem(where: str, limits: Limits, value: float, remedy: str) -> Iterator[Problem]:
    try:
        limits.check("the value", value, remedy)
    except DeviceLimitError as error:
        yield Problem(where, str(error))
