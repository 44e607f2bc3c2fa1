"""What the table `[camera.device]` says of a Luxonis OAK."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from drivers.device_settings import DeviceSettings
from drivers.limits import Limits

# As the SDK states it for its cameras; a sensor may stop earlier, which its frames then tell.
_SHORTEST_EXPOSURE_TIME = 1e-6
_FASTEST = 30.0  # frames per second
_DUTY = 0.9  # of the time of a frame that an exposure may fill, so that the sensor need not shorten it


class OakSettings(DeviceSettings):
    """One sensor of a Luxonis OAK; nothing of it is automatic.

    No camera tells its conversion gain and its read noise. Where they are not stated they stay unknown, and the
    analysis estimates both.
    """

    bayer_pattern: Literal["RGGB", "BGGR", "GRBG", "GBRG", ""] = Field(
        description='colours of the 2 x 2 cell in reading order as this sensor delivers it, "" for monochrome; '
        "the camera does not tell it"
    )
    socket: Literal["CAM_A", "CAM_B", "CAM_C", "CAM_D"] = Field(
        default="CAM_A", description="which sensor; CAM_A is the colour one of most models"
    )
    iso: int = Field(default=100, ge=100, le=1600, description="sensitivity; the lowest has the most dynamic range")
    white_balance_k: int = Field(
        default=5000, ge=1000, le=12000, description="colour temperature, fixed; raw frames do not depend on it"
    )
    lens_position: int | None = Field(
        default=None, ge=0, le=255, description="of a lens with autofocus, which is off; default: a fixed lens"
    )
    longest_exposure_s: float = Field(
        default=0.03, gt=0.0, le=0.5, description="the longer, the slower the sensor runs, whatever the exposure is"
    )
    bit_depth: Literal[8, 10, 12, 14, 16] = Field(default=10, description="bits of a raw count")
    black_level: float = Field(default=0.0, ge=0.0, description="nominal count of darkness")
    saturation_level: float | None = Field(
        default=None, gt=0.0, description="nominal count of clipping; default: the highest that bit_depth holds"
    )
    conversion_gain: float | None = Field(
        default=None, gt=0.0, description="electrons per count at this iso; default: unknown"
    )
    read_noise: float | None = Field(default=None, ge=0.0, description="electrons; default: unknown")

    @property
    def exposure_time_limits(self) -> Limits:
        """In seconds."""
        return Limits(_SHORTEST_EXPOSURE_TIME, self.longest_exposure_s, "s")

    @property
    def frame_rate(self) -> float:
        """Frames per second at which the longest exposure fits into a frame."""
        return min(_FASTEST, _DUTY / self.longest_exposure_s)

    @property
    def clipping_count(self) -> float:
        """Nominal count of clipping."""
        return float(2**self.bit_depth - 1) if self.saturation_level is None else self.saturation_level
