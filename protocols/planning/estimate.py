"""Estimates time and size of a capture, without moving or lighting anything."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

from drivers.errors import DeviceLimitError
from drivers.registry import open_devices
from drivers.stage import Stage
from instrument.config.protocol import ProtocolConfig
from instrument.config.rig import RigConfig
from instrument.rig.rig import OpenDevices, Rig
from protocols.planning.earlier_darks import KeptFrames
from protocols.planning.plan import duration
from protocols.planning.planned_poses import PlannedPoses
from protocols.planning.prepare import Prepared, prepare

# Seconds to read, check and hand over one frame besides its exposure.
FRAME_OVERHEAD = 0.02


@dataclass(frozen=True, slots=True)
class Outlook:
    """The estimate of a capture.

    Attributes
    ----------
    n_poses, n_frames, n_darks, n_flats : int
        Poses, frames in the light, frames in the dark, frames of an even plane.
    exposure_times_s : tuple of float
        Seconds; of a metered bracket the range and number that it may have at most.
    is_metered : bool
        Whether scout frames choose the bracket when the capture begins.
    seconds : float
        How long it takes, motions and warm-up included.
    light_on_seconds : float
        Exposure with the light on, and the warm-up.
    warm_up_seconds : float
        At most.
    picture_bytes : int
        Of all pictures, uncompressed; exact.
    bytes : int
        Disk space at most; compression saves about half.
    darks : str
        Where they come from.
    serial_numbers : dict of str to str
        Of the devices.
    warnings : tuple of str
        What does not forbid the capture.
    plan_sha256 : str
        Digest of the plan; empty where scout frames have yet to complete it.
    planned : PlannedPoses or None
        The poses themselves, to be shown; no part of the text or of `as_dict`.
    """

    protocol: str
    rig: str
    n_poses: int
    n_frames: int
    n_darks: int
    n_flats: int
    exposure_times_s: tuple[float, ...]
    is_metered: bool
    seconds: float
    light_on_seconds: float
    warm_up_seconds: float
    picture_bytes: int
    bytes: int
    darks: str
    serial_numbers: dict[str, str]
    warnings: tuple[str, ...]
    plan_sha256: str
    planned: PlannedPoses | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate by name."""
        values = asdict(replace(self, planned=None))
        del values["planned"]
        return values

    def as_text(self) -> str:
        """Return lines for the operator."""
        times = ", ".join(f"{time:g}" for time in self.exposure_times_s)
        bracket = (
            f"chosen by scout frames, at most {len(self.exposure_times_s)}" if self.is_metered else f"of {times} s"
        )
        devices = ", ".join(f"{kind} {serial}" for kind, serial in self.serial_numbers.items())
        lines = [
            f"{self.protocol} on {self.rig}",
            f"  poses     {self.n_poses}",
            f"  frames    {self.n_frames} {bracket}" + (f", and {self.n_flats} flats" if self.n_flats else ""),
            f"  darks     {self.darks}",
            f"  time      about {duration(self.seconds)}",
            f"  light on  {duration(self.light_on_seconds)}"
            + (f", of which up to {duration(self.warm_up_seconds)} to warm up" if self.warm_up_seconds else ""),
            f"  disk      up to {self.bytes / 1e6:.0f} MB ({self.picture_bytes} bytes of pictures before compression)",
            f"  devices   {devices}",
            f"  plan      {'sha256 ' + self.plan_sha256 if self.plan_sha256 else 'complete after the scout frames'}",
            *(f"  warning   {warning}" for warning in self.warnings),
        ]
        return "\n".join(lines)


def estimate(rig_config: RigConfig, protocol_config: ProtocolConfig, devices: OpenDevices = open_devices) -> Outlook:
    """Connect to the rig, check the protocol against its limits, and estimate the capture.

    Raises
    ------
    InvalidInputError
        If the rig cannot do the protocol, with every reason.
    DeviceError
        If a device cannot be connected, or another process holds the rig.
    """
    with Rig.connected(rig_config, devices) as rig:
        return _outlook(rig, prepare(rig, protocol_config))


def _outlook(rig: Rig, prepared: Prepared) -> Outlook:
    plan, camera, warm_up = prepared.plan, rig.camera.describe(), rig.config.light.warm_up_s
    is_metered = prepared.protocol.bracket.auto is not None
    return Outlook(
        protocol=prepared.protocol.name,
        rig=rig.config.name,
        n_poses=plan.n_poses,
        n_frames=plan.n_frames,
        n_darks=plan.n_darks,
        n_flats=plan.flats,
        exposure_times_s=plan.exposure_times,
        is_metered=is_metered,
        seconds=warm_up + plan.seconds(partial(_way_duration, rig.stage), FRAME_OVERHEAD),
        light_on_seconds=warm_up + plan.lit_seconds,
        warm_up_seconds=warm_up,
        picture_bytes=plan.picture_bytes(camera.height, camera.width),
        bytes=plan.bytes(camera.height, camera.width),
        darks=_darks_text(plan.darks, len(plan.exposure_times), prepared.kept),
        serial_numbers=rig.serial_numbers,
        warnings=prepared.warnings,
        plan_sha256="" if is_metered else plan.sha256,
        planned=PlannedPoses.of(rig, plan),
    )


def _darks_text(count: int, n_exposures: int, kept: KeptFrames | None) -> str:
    if kept is not None:
        return f"of {kept.path}, {kept.age_hours:.1f} h old"
    return f"{count} of each exposure time, {count * n_exposures} in all" if count else "none"


def _way_duration(stage: Stage, way: Mapping[str, float]) -> float:
    """Return the seconds for a way along each axis; one longer than the stage reaches from zero, in pieces."""
    for pieces in (1, 2, 4):
        try:
            return pieces * stage.move_duration({axis: length / pieces for axis, length in way.items()})
        except DeviceLimitError:
            continue
    return 0.0
