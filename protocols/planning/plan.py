"""A plan: every pose of a capture, frozen before the first motion and never computed again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import Any

from instrument.config.protocol import BracketConfig, ProtocolConfig
from instrument.files.validation import InvalidInputError, Problem
from instrument.session.preview import preview_shape
from protocols.poses.patterns import Pose, repeated, ring

PLAN_VERSION = "1.0"

# How much shorter than the shortest exposure the spare one is, for poses at which that clips.
SPARE_FACTOR = 0.25


@dataclass(frozen=True)
class Plan:
    """What to capture, in order.

    Attributes
    ----------
    axes : tuple of str
        Names of the stage axes that the poses place.
    positions : tuple of tuple of float, length P
        A position per axis for each pose, in degrees or millimetres as the stage has it.
    exposure_times : tuple of float, length E
        Seconds, ascending; one frame each at every pose.
    darks : int
        Frames with the light off per exposure time, before the first pose.
    flats : int
        Frames of an even plane at the first pose, before all others.
    flat_time : float
        Their exposure time, seconds.
    interval : float
        Seconds from the begin of one pose to that of the next, at least.
    when_clipped : {"flag", "pause", "shorter"}
        What to do at a pose whose shortest exposure clips. With "shorter" the first exposure is a spare one: its
        frame is taken at such poses only, and its slot stays empty at all others.
    """

    axes: tuple[str, ...]
    positions: tuple[tuple[float, ...], ...]
    exposure_times: tuple[float, ...]
    darks: int
    flats: int = 0
    flat_time: float = 0.0
    interval: float = 0.0
    when_clipped: str = "flag"

    @classmethod
    def from_protocol(
        cls, protocol: ProtocolConfig, chosen: Iterable[Pose] = (), exposure_times: tuple[float, ...] | None = None
    ) -> Plan:
        """Return the plan of a protocol: its rings in their order, then its single poses, then those chosen.

        Parameters
        ----------
        protocol : ProtocolConfig
        chosen : iterable of mapping
            The poses that its table ``[chosen]`` stands for.
        exposure_times : tuple of float, optional
            Seconds, as scout frames found them; the protocol's by default.
        """
        poses = [*stated_poses(protocol), *chosen]
        watch, flats, bracket = protocol.watch, protocol.flats, protocol.bracket
        axes = tuple(sorted(poses[0]))
        return cls(
            axes=axes,
            positions=tuple(
                tuple(float(pose[axis]) for axis in axes) for pose in repeated(poses, watch.repeats if watch else 1)
            ),
            exposure_times=_with_spare(bracket, exposure_times or bracket.exposure_times_s or ()),
            darks=0 if protocol.darks_and_flats else bracket.darks,
            flats=flats.count if flats else 0,
            flat_time=flats.exposure_time_s if flats else 0.0,
            interval=watch.interval_s if watch else 0.0,
            when_clipped=bracket.when_clipped,
        )

    @classmethod
    def from_json(cls, text: str) -> Plan:
        """Return the plan that `json` wrote.

        Raises
        ------
        InvalidInputError
            If `text` is no such plan.
        """
        try:
            data = json.loads(text)
            plan = cls(
                axes=tuple(data["axes"]),
                positions=tuple(tuple(pose) for pose in data["positions"]),
                exposure_times=tuple(data["exposure_times_s"]),
                darks=data["darks"],
                flats=data.get("flats", 0),
                flat_time=data.get("flat_time_s", 0.0),
                interval=data.get("interval_s", 0.0),
                when_clipped=data.get("when_clipped", "flag"),
            )
            if plan.json == text:
                return plan
        except (ValueError, KeyError, TypeError, AttributeError):
            pass
        why = f"is not the canonical text of a plan of version {PLAN_VERSION}"
        raise InvalidInputError("the plan cannot be used", [Problem("/entry/plan/json", why)])

    @cached_property
    def json(self) -> str:
        """The plan as canonical JSON: sorted keys, no spaces, shortest digits that read back the same.

        A key that says nothing is left out, so that plans of one kind read the same whatever other kinds there are.
        """
        content: dict[str, Any] = {
            "axes": self.axes,
            "darks": self.darks,
            "exposure_times_s": self.exposure_times,
            "positions": self.positions,
            "version": PLAN_VERSION,
        }
        further = {"flats": self.flats, "flat_time_s": self.flat_time, "interval_s": self.interval}
        content |= {key: value for key, value in further.items() if value}
        if self.when_clipped != "flag":
            content["when_clipped"] = self.when_clipped
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)

    @cached_property
    def sha256(self) -> str:
        """Hex digest of `json`."""
        return sha256(self.json.encode()).hexdigest()

    @property
    def n_poses(self) -> int:
        """P."""
        return len(self.positions)

    @property
    def n_spare(self) -> int:
        """How many of the first exposures are taken only where the next one clips."""
        return 1 if self.when_clipped == "shorter" else 0

    @property
    def n_frames(self) -> int:
        """Frames in the light of the poses, P times E at most."""
        return self.n_poses * (len(self.exposure_times) - self.n_spare)

    @property
    def n_darks(self) -> int:
        """Dark frames in all."""
        return self.darks * len(self.exposure_times)

    @property
    def lit_seconds(self) -> float:
        """Seconds of exposure with the light on."""
        return self.n_poses * sum(self.exposure_times[self.n_spare :]) + self.flats * self.flat_time

    @property
    def targets(self) -> dict[str, tuple[float, ...]]:
        """Position of each axis at each pose; length P."""
        return {axis: tuple(pose[i] for pose in self.positions) for i, axis in enumerate(self.axes)}

    def target(self, i_pose: int) -> dict[str, float]:
        """Return the position of each axis at one pose."""
        return dict(zip(self.axes, self.positions[i_pose], strict=True))

    def picture_bytes(self, height: int, width: int) -> int:
        """Return the bytes of all pictures of the session, uncompressed: frames, darks, flats and previews."""
        h, w = preview_shape(height, width)
        n_exposures = len(self.exposure_times)
        frames = 2 * (self.n_poses * n_exposures + self.flats) * height * width
        darks = 8 * n_exposures * height * width if self.darks else 0
        return frames + darks + 4 * self.n_poses * h * w

    def bytes(self, height: int, width: int) -> int:
        """Return the bytes that the session may need: pictures that do not compress, and all else."""
        return self.picture_bytes(height, width) + 600 * self.n_poses * len(self.exposure_times) + 300_000

    def seconds(self, move_duration: Callable[[Mapping[str, float]], float], frame_overhead: float) -> float:
        """Return about how long the capture takes.

        Parameters
        ----------
        move_duration : callable
            Seconds to go from zero to a position, as a stage that stands at zero says.
        frame_overhead : float
            Seconds to read and store one frame.
        """
        ways = zip([(0.0,) * len(self.axes), *self.positions], self.positions, strict=False)
        moves = [
            move_duration({axis: abs(b - a) for axis, a, b in zip(self.axes, start, end, strict=True)})
            for start, end in ways
        ]
        # The frame that looks whether the light went out is a short one.
        times = self.exposure_times[self.n_spare :]
        bracket = sum(times) + times[0] + frame_overhead * (len(times) + 1)
        poses = sum(max(move + bracket, self.interval) for move in moves[:-1]) + moves[-1] + bracket
        darks = self.darks * (sum(self.exposure_times) + frame_overhead * len(self.exposure_times))
        return poses + darks + self.flats * (self.flat_time + frame_overhead)


def stated_poses(protocol: ProtocolConfig) -> tuple[Pose, ...]:
    """Return the poses of a protocol's rings in their order, then its single ones."""
    rings = [pose for table in protocol.rings for pose in ring(table.tilt_deg, table.count, table.start_deg)]
    return (*rings, *(pose.axes for pose in protocol.poses))


def _with_spare(bracket: BracketConfig, times: tuple[float, ...]) -> tuple[float, ...]:
    return (SPARE_FACTOR * times[0], *times) if bracket.when_clipped == "shorter" and times else times


def duration(seconds: float) -> str:
    """Return a time as an operator reads it."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{seconds:.3g} s"
