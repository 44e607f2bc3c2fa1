"""Makes a plan of a protocol for a connected rig, or reports all reasons why it cannot be carried out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.errors import DeviceLimitError
from drivers.limits import Limits
from instrument.config.loading import ProtocolConfig
from instrument.config.protocol import AutoConfig
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.files.whole_file import InsufficientSpaceError, check_space
from instrument.rig.rig import Rig
from protocols.planning.earlier_darks import KeptFrames
from protocols.planning.metering import Metered, meter
from protocols.planning.plan import Plan, stated_poses
from protocols.poses.choice import choose_poses
from protocols.poses.patterns import Pose

TITLE = "the rig cannot do this protocol"


@dataclass(frozen=True, slots=True)
class Prepared:
    """A protocol that a rig can carry out.

    Attributes
    ----------
    protocol : ProtocolConfig
    plan : Plan
        Without scout frames, the exposure times of a metered bracket are only about right.
    kept : KeptFrames or None
        Darks and flats of an earlier session.
    warnings : tuple of str
        What does not forbid the capture.
    chosen : tuple of mapping
        Poses that were chosen for their information.
    """

    protocol: ProtocolConfig
    plan: Plan
    kept: KeptFrames | None
    warnings: tuple[str, ...]
    chosen: tuple[Pose, ...] = ()

    def metered(self, rig: Rig) -> tuple[Prepared, Metered | None]:
        """Return this with the bracket that scout frames ask for; unchanged where the times are stated.

        Raises
        ------
        DeviceError
            If a device fails, or no bracket keeps the bound.
        InvalidInputError
            If the darks of an earlier session do not fit the bracket.
        """
        auto = self.protocol.bracket.auto
        if auto is None:
            return self, None
        # Before it has found its zero, a stage goes anywhere but where it is told.
        rig.stage.home()
        metered = meter(rig, self.plan, auto)
        plan = Plan.from_protocol(self.protocol, self.chosen, metered.exposure_times)
        raise_if_any(TITLE, _kept_problems(rig, self.protocol, plan, self.kept))
        return Prepared(self.protocol, plan, self.kept, self.warnings, self.chosen), metered


def prepare(rig: Rig, protocol: ProtocolConfig, path: Path | None = None) -> Prepared:
    """Return the plan of a protocol, checked against the rig.

    Parameters
    ----------
    rig : Rig
        Connected; nothing moves or lights.
    protocol : ProtocolConfig
    path : Path, optional
        The session to write, where there must be space; not checked if not given.

    Raises
    ------
    InvalidInputError
        With every reason against it.
    """
    auto = protocol.bracket.auto
    chosen = _chosen(rig, protocol)
    plan = Plan.from_protocol(protocol, chosen, None if auto is None else _about(auto))
    problems = list(preflight_problems(rig, plan))
    if path is not None:
        problems += space_problems(rig, plan, path)
    kept, of_kept = _read_kept(protocol)
    problems += of_kept
    if auto is None:
        problems += _kept_problems(rig, protocol, plan, kept)
    raise_if_any(TITLE, problems)
    return Prepared(protocol, plan, kept, tuple(_warnings(rig, kept)), chosen)


def _chosen(rig: Rig, protocol: ProtocolConfig) -> tuple[Pose, ...]:
    """Return the poses that the table ``[chosen]`` stands for, chosen beside all others of the protocol."""
    if protocol.chosen is None:
        return ()
    return choose_poses(rig.config, rig.stage.describe().axes, protocol.chosen, stated_poses(protocol))


def _about(auto: AutoConfig) -> tuple[float, ...]:
    """Return exposure times that take as long and as many bytes as a metered bracket may at most."""
    n = auto.most_exposures if auto.shortest_s < auto.longest_s else 1
    return tuple(np.geomspace(auto.shortest_s, auto.longest_s, n).tolist()) if n > 1 else (auto.longest_s,)


def _read_kept(protocol: ProtocolConfig) -> tuple[KeptFrames | None, tuple[Problem, ...]]:
    if protocol.darks_and_flats is None:
        return None, ()
    try:
        return KeptFrames.read(Path(protocol.darks_and_flats.session)), ()
    except InvalidInputError as error:
        return None, error.problems


def _kept_problems(rig: Rig, protocol: ProtocolConfig, plan: Plan, kept: KeptFrames | None) -> Iterator[Problem]:
    if kept is not None and protocol.darks_and_flats is not None:
        yield from kept.problems(protocol.darks_and_flats, rig.camera.describe(), plan.exposure_times)


def _warnings(rig: Rig, kept: KeptFrames | None) -> Iterator[str]:
    if kept is not None and kept.rig_text != rig.config.text:
        yield f"the rig file was changed since {kept.path} was captured; take darks and flats anew if that matters"


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
        yield Problem(str(path.parent), str(error))


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
