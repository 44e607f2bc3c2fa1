"""What the table `[camera.device]` says of a GenICam camera."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from drivers.device_settings import DeviceSettings
from drivers.genicam.pixels import raw_format

Offset = Annotated[int, Field(ge=0)]


class GenicamSettings(DeviceSettings):
    """A camera with USB3 Vision or GigE Vision.

    No camera tells its conversion gain and its read noise. Where the data sheet does not either they stay unknown, and
    the analysis estimates both from a bracket of three exposures: better than a guess, which every sigma would rest on.
    """

    conversion_gain: float | None = Field(
        default=None,
        gt=0.0,
        description="Electrons per count at this pixel format and gain, from the data sheet (EMVA 1288: 1 over the "
        "system gain K); default: unknown.",
    )
    read_noise: float | None = Field(
        default=None,
        ge=0.0,
        description="Electrons of read-out noise, from the data sheet (EMVA 1288: temporal dark noise); "
        "default: unknown.",
    )
    address: str = Field(
        default="",
        description="Address in the network (IP), or the id that `arv-tool-0.8` lists; "
        "default: the camera with [camera] serial_number, or the only one there is.",
    )
    pixel_format: str = Field(
        default="",
        description='Raw and unpacked, e.g. "Mono12" or "BayerRG16"; default: the deepest that the camera has.',
    )
    gain_db: float = Field(
        default=0.0,
        description="Gain in dB, or in steps of the camera's own where it has only those; "
        "at 0 a camera whose range begins above takes its lowest.",
    )
    black_level: float = Field(default=0.0, ge=0.0, description="Nominal count of darkness.")
    saturation_level: float | None = Field(
        default=None,
        gt=0.0,
        description="Nominal count of clipping; default: the highest that the pixel format holds. "
        "A sensor of 12 bits that fills 16 from the left clips at 65520.",
    )
    offset_x: Offset | None = Field(
        default=None, description="First column of the region on the sensor; default: centred."
    )
    offset_y: Offset | None = Field(
        default=None, description="First row of the region on the sensor; default: centred."
    )

    @field_validator("pixel_format")
    @classmethod
    def _must_be_raw(cls, name: str) -> str:
        return raw_format(name).name if name else ""
