"""What a capture would take, without a motion or a flash."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from drivers.errors import DeviceLimitError
from drivers.registry import open_devices
from drivers.stage import Stage
from instrument.config import ProtocolConfig, RigConfig
from instrument.rig import OpenDevices, Rig
from instrument.validation import raise_if_any
from protocols.plan import Plan
from protocols.preflight import preflight_problems

# Seconds to read, check and write one frame besides its exposure.
FRAME_OVERHEAD = 0.05


@dataclass(frozen=True, slots=True)
class Outlook:
    """The estimate of a capture.

    Attributes
    ----------
    n_poses, n_frames, n_darks : int
        Poses, frames in the light, frames in the dark.
    exposure_times_s : tuple of float
        Seconds.
    seconds : float
        How long it takes, motions included.
    light_on_seconds : float
        Exposure with the light on.
    bytes : int
        Disk space at most; compression saves about half.
    plan_sha256 : str
        Digest of the plan.
    """

    protocol: str
    rig: str
    n_poses: int
    n_frames: int
    n_darks: int
    exposure_times_s: tuple[float, ...]
    seconds: float
    light_on_seconds: float
    bytes: int
    plan_sha256: str

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name."""
        return asdict(self)

    def as_text(self) -> str:
        """Return lines for the operator."""
        times = ", ".join(f"{time:g}" for time in self.exposure_times_s)
        return "\n".join(
            (
                f"{self.protocol} on {self.rig}",
                f"  poses     {self.n_poses}",
                f"  frames    {self.n_frames} of {times} s, and {self.n_darks} darks",
                f"  time      about {_duration(self.seconds)}",
                f"  light on  {_duration(self.light_on_seconds)}",
                f"  disk      up to {self.bytes / 1e6:.0f} MB",
                f"  plan      sha256 {self.plan_sha256}",
            )
        )


def dry_run(rig_config: RigConfig, protocol_config: ProtocolConfig, devices: OpenDevices = open_devices) -> Outlook:
    """Connect to the rig, check the protocol against its limits, and estimate the capture.

    Raises
    ------
    InvalidInputError
        If the rig cannot do the protocol, with every reason.
    DeviceError
        If a device cannot be connected.
    """
    plan = Plan.from_protocol(protocol_config)
    with Rig.connected(rig_config, devices) as rig:
        raise_if_any("the rig cannot do this protocol", preflight_problems(rig, plan))
        camera = rig.camera.describe()
        return Outlook(
            protocol=protocol_config.name,
            rig=rig_config.name,
            n_poses=plan.n_poses,
            n_frames=plan.n_frames,
            n_darks=plan.n_darks,
            exposure_times_s=plan.exposure_times,
            seconds=plan.seconds(partial(_way_duration, rig.stage), FRAME_OVERHEAD),
            light_on_seconds=plan.lit_seconds,
            bytes=plan.bytes(camera.height, camera.width),
            plan_sha256=plan.sha256,
        )


def _way_duration(stage: Stage, way: Mapping[str, float]) -> float:
    """Return the seconds for a way along each axis; one longer than the stage reaches from zero, in pieces."""
    for pieces in (1, 2, 4):
        try:
            return pieces * stage.move_duration({axis: length / pieces for axis, length in way.items()})
        except DeviceLimitError:
            continue
    return 0.0


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{seconds:.3g} s"
