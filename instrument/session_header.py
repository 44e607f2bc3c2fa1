"""All that is known about a session before its first pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.camera import CameraDescription
from drivers.light import LightDescription
from drivers.stage import StageDescription
from instrument.protocol_config import ProtocolConfig
from instrument.rig_config import RigConfig


@dataclass(frozen=True, slots=True)
class SessionHeader:
    """What a session file holds from the start and never changes.

    Attributes
    ----------
    plan_json, plan_sha256 : str
        The plan in canonical form and the digest of exactly that text.
    exposure_times : tuple of float, length E
        Seconds.
    targets : mapping of str to tuple of float, length P
        Wanted position of each axis at each pose, in degrees or millimetres.
    darks : int
        Dark frames per exposure time.
    """

    rig: RigConfig
    protocol: ProtocolConfig
    plan_json: str
    plan_sha256: str
    exposure_times: tuple[float, ...]
    targets: Mapping[str, tuple[float, ...]]
    darks: int
    camera: CameraDescription
    light: LightDescription
    stage: StageDescription

    @property
    def n_poses(self) -> int:
        """How many poses the plan has."""
        return len(next(iter(self.targets.values())))

    @property
    def frame_shape(self) -> tuple[int, int]:
        """Height and width of a frame in pixels."""
        return self.camera.height, self.camera.width
