"""A plan: every pose of a capture, frozen before the first motion and never computed again."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import Any

from instrument.preview import preview_shape
from instrument.protocol_config import ProtocolConfig, RingConfig
from instrument.validation import InvalidInputError, Problem

PLAN_VERSION = "1.0"


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
    """

    axes: tuple[str, ...]
    positions: tuple[tuple[float, ...], ...]
    exposure_times: tuple[float, ...]
    darks: int

    @classmethod
    def from_protocol(cls, protocol: ProtocolConfig) -> Plan:
        """Return the plan of a protocol: its rings in their order, then its single poses."""
        rings = [pose for ring in protocol.rings for pose in _ring_poses(ring)]
        poses = [*rings, *(pose.axes for pose in protocol.poses)]
        axes = tuple(sorted(poses[0]))
        positions = tuple(tuple(pose[axis] for axis in axes) for pose in poses)
        return cls(axes, positions, protocol.bracket.exposure_times_s, protocol.bracket.darks)

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
            )
            if plan.json == text:
                return plan
        except (ValueError, KeyError, TypeError):
            pass
        why = f"is not the canonical text of a plan of version {PLAN_VERSION}"
        raise InvalidInputError("the plan cannot be used", [Problem("/entry/plan/json", why)])

    @cached_property
    def json(self) -> str:
        """The plan as canonical JSON: sorted keys, no spaces, shortest digits that read back the same."""
        content: dict[str, Any] = {
            "axes": self.axes,
            "darks": self.darks,
            "exposure_times_s": self.exposure_times,
            "positions": self.positions,
            "version": PLAN_VERSION,
        }
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
    def n_frames(self) -> int:
        """P times E, darks not counted."""
        return self.n_poses * len(self.exposure_times)

    @property
    def n_darks(self) -> int:
        """Dark frames in all."""
        return self.darks * len(self.exposure_times)

    @property
    def lit_seconds(self) -> float:
        """Seconds of exposure with the light on."""
        return self.n_poses * sum(self.exposure_times)

    @property
    def targets(self) -> dict[str, tuple[float, ...]]:
        """Position of each axis at each pose; length P."""
        return {axis: tuple(pose[i] for pose in self.positions) for i, axis in enumerate(self.axes)}

    def target(self, i_pose: int) -> dict[str, float]:
        """Return the position of each axis at one pose."""
        return dict(zip(self.axes, self.positions[i_pose], strict=True))

    def bytes(self, height: int, width: int) -> int:
        """Return the bytes that the session may need: frames uncompressed, darks, previews, tables."""
        h, w = preview_shape(height, width)
        n_exposures = len(self.exposure_times)
        frames = 2 * self.n_frames * height * width
        darks = 8 * n_exposures * height * width if self.darks else 0
        return frames + darks + 4 * self.n_poses * h * w + 500 * self.n_frames + 200_000

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
        moves = sum(
            move_duration({axis: abs(b - a) for axis, a, b in zip(self.axes, start, end, strict=True)})
            for start, end in ways
        )
        exposures = self.lit_seconds + self.darks * sum(self.exposure_times)
        return moves + exposures + frame_overhead * (self.n_frames + self.n_darks)


def _ring_poses(ring: RingConfig) -> list[dict[str, float]]:
    """Return the poses of a ring; turns go round once and wrap into 0 to 360 degrees."""
    turns = ((ring.start_deg + 360.0 * i / ring.count) % 360.0 for i in range(ring.count))
    return [{"tilt": ring.tilt_deg, "turn": turn} for turn in turns]
