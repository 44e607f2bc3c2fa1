"""Set a camera as the rig file says, compare what it reads back, and describe what came of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from drivers.camera import CameraDescription
from drivers.errors import DeviceError, DeviceLimitError
from drivers.genicam.link import GenicamLink, Region, Side, Steps
from drivers.genicam.neutral import put_to_neutral
from drivers.genicam.pixels import PixelFormat, deepest, raw_format, shifted_pattern
from drivers.genicam.settings import GenicamSettings
from drivers.limits import Limits
from drivers.readback import Setting, confirm

_PIXEL_FORMAT = "PixelFormat"
# Cameras keep gains in steps of up to a tenth of a decibel.
_GAIN_TOLERANCE = 0.11


@dataclass(frozen=True, slots=True)
class Configuration:
    """How a camera is set.

    Attributes
    ----------
    pixel_format : PixelFormat
    bayer_pattern : str
        Of the region, in reading order.
    region : Region
    settings : tuple of Setting
        As they read back.
    """

    pixel_format: PixelFormat
    bayer_pattern: str
    region: Region
    settings: tuple[Setting, ...]


def configure(link: GenicamLink, wanted: GenicamSettings, width: int, height: int) -> Configuration:
    """Set a camera, its region `width` x `height` pixels.

    Raises
    ------
    DeviceLimitError
        If it does not allow that: all that it does not, with what it does.
    DeviceError
        If it does not keep what it was given.
    """
    put_to_neutral(link)
    pixels = _set_pixel_format(link, wanted)
    region = _set_region(link, wanted, width, height)
    gain = _set_gain(link, wanted.gain_db)
    named = link.text(_PIXEL_FORMAT)
    # Some cameras rename the format with the offset, others leave it to the reader.
    shift = (region.x, region.y) if named == pixels.name else (0, 0)
    pattern = shifted_pattern(raw_format(named).bayer_pattern, *shift)
    return Configuration(pixels, pattern, region, (_format_setting(link), *gain, *_read_settings(link, region)))


def describe(
    link: GenicamLink, wanted: GenicamSettings, found: Configuration, exposure_time_limits: Limits
) -> CameraDescription:
    """Return what a configured camera is."""
    identity = link.identity
    clipped = (1 << found.pixel_format.bit_depth) - 1
    return CameraDescription(
        make=identity.make,
        model=identity.model,
        serial_number=identity.serial_number,
        height=found.region.height,
        width=found.region.width,
        bit_depth=found.pixel_format.bit_depth,
        black_level=wanted.black_level,
        saturation_level=float(clipped) if wanted.saturation_level is None else wanted.saturation_level,
        bayer_pattern=found.bayer_pattern,
        conversion_gain=math.nan if wanted.conversion_gain is None else wanted.conversion_gain,
        read_noise=math.nan if wanted.read_noise is None else wanted.read_noise,
        exposure_time_limits=exposure_time_limits,
        firmware=identity.firmware,
        settings=found.settings,
    )


def _check_kept(name: str, wanted: str, read_back: str) -> None:
    if wanted != read_back:
        raise DeviceError(
            f"{name} was set to {wanted} and reads back {read_back}. "
            "Set it with the camera's own program, and save it there"
        )


def _set_pixel_format(link: GenicamLink, wanted: GenicamSettings) -> PixelFormat:
    available = link.choices(_PIXEL_FORMAT)
    name = wanted.pixel_format or deepest(available).name
    if name not in available:
        raise DeviceLimitError(
            f"pixel_format is {name!r}; this camera has {', '.join(available)}. Correct [camera.device] pixel_format"
        )
    link.set_text(_PIXEL_FORMAT, name)
    _check_kept("pixel_format", name, link.text(_PIXEL_FORMAT))
    return raw_format(name)


def _set_region(link: GenicamLink, wanted: GenicamSettings, width: int, height: int) -> Region:
    # Its sides have their whole range when it begins at the corner.
    now = link.region()
    link.set_region(now._replace(x=0, y=0))
    columns, rows = link.steps("width"), link.steps("height")
    region = Region(
        _offset(wanted.offset_x, link.steps("x_offset"), columns.high - width),
        _offset(wanted.offset_y, link.steps("y_offset"), rows.high - height),
        width,
        height,
    )
    problems = [*_side_problems(link, region, columns, rows)]
    if problems:
        raise DeviceLimitError("; ".join(problems))
    link.set_region(region)
    if link.region() != region:
        raise DeviceError(f"the region was set to {region} and reads back {link.region()}. Take sides that it keeps")
    return region


def _offset(wanted: int | None, steps: Steps, room: int) -> int:
    """Return the offset that is wanted, or the one that centres: even, so that a Bayer cell stays whole."""
    if wanted is not None:
        return wanted
    step = math.lcm(steps.step, 2)
    return max(0, room) // 2 // step * step


def _side_problems(link: GenicamLink, region: Region, columns: Steps, rows: Steps) -> Iterator[str]:
    offsets = (link.steps("x_offset").step, link.steps("y_offset").step)
    # The camera's own limits of an offset may be those of another size.
    right, bottom = max(0, columns.high - region.width), max(0, rows.high - region.height)
    yield from _problem("[camera] width", region.width, columns)
    yield from _problem("[camera] height", region.height, rows)
    yield from _problem("[camera.device] offset_x", region.x, Steps(0, right, offsets[0]))
    yield from _problem("[camera.device] offset_y", region.y, Steps(0, bottom, offsets[1]))


def _problem(name: str, value: int, steps: Steps) -> Iterator[str]:
    low, high, step = steps
    if not (low <= value <= high and (value - low) % step == 0):
        yield f"{name} is {value} px; this camera takes {low} to {high} in steps of {step}"


def _set_gain(link: GenicamLink, wanted: float) -> tuple[Setting, ...]:
    if not link.has_number("gain"):
        if wanted:
            raise DeviceLimitError(f"gain_db is {wanted:g}; this camera has no gain. Leave [camera.device] gain_db out")
        return ()
    unit = link.unit("gain")
    limits = Limits(*link.bounds("gain"), unit)
    gain = max(wanted, limits.low) if wanted == 0.0 else wanted
    limits.check("gain_db", gain, "Correct [camera.device] gain_db.")
    link.set_number("gain", gain)
    read_back = link.number("gain")
    confirm("gain_db", gain, read_back, _GAIN_TOLERANCE, unit)
    return (Setting("gain", read_back, unit, limits),)


def _format_setting(link: GenicamLink) -> Setting:
    return Setting("pixel_format", link.text(_PIXEL_FORMAT), choices=link.choices(_PIXEL_FORMAT))


def _read_settings(link: GenicamLink, region: Region) -> Iterator[Setting]:
    sides: tuple[tuple[str, Side, int], ...] = (
        ("width", "width", region.width),
        ("height", "height", region.height),
        ("offset_x", "x_offset", region.x),
        ("offset_y", "y_offset", region.y),
    )
    for name, side, value in sides:
        low, high, _ = link.steps(side)
        yield Setting(name, float(value), "px", Limits(low, high, "px"))
    if link.has_number("black_level"):
        limits = Limits(*link.bounds("black_level"), link.unit("black_level"))
        yield Setting("black_level", link.number("black_level"), limits.unit, limits)
