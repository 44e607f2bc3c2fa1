"""Checks a rig: identifies each device, then shines, moves and takes a frame."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription
from drivers.errors import DeviceError, NotHomedError
from drivers.light import LightDescription
from drivers.registry import open_devices
from drivers.stage import AxisDescription, StageDescription
from instrument.config.rig import RigConfig
from instrument.rig.linearity import ALLOWED, measure_linearity
from instrument.rig.rig import OpenDevices, Rig

Verdict = Literal["PASS", "WARN", "FAIL"]

DIM = 0.1
"""Level of the light that blinks."""

LEASE = 2.0
"""Seconds that it may shine, if nobody switches it off."""

STEP = 1.0
"""Degrees or millimetres that an axis moves, and back."""

EXPOSURE_TIME = 0.01
"""Seconds."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What one step found out about one device."""

    verdict: Verdict
    kind: str
    text: str


Findings = Iterator[Finding]

Counts = NDArray[np.uint16]


def check_rig(
    config: RigConfig, devices: OpenDevices = open_devices, *, home: bool = False, linearity: bool = False
) -> Findings:
    """Yield what works and what does not; leave the rig dark, stopped and disconnected.

    A device that fails keeps none of the others from being looked at.

    Parameters
    ----------
    config : RigConfig
    devices : callable
        Takes the configuration's tables and returns the devices.
    home : bool
        Let the stage find its zero first, over its whole way.
    linearity : bool
        Also take a bracket: on a plate that keeps still, counts have to be proportional to the exposure time.

    Raises
    ------
    RigBusyError
        If another process holds the rig.
    """
    with Rig.held(config, devices) as rig:
        try:
            yield from _check(rig, home, linearity)
        finally:
            failures = rig.safe()
        yield from (Finding("FAIL", "rig", failure) for failure in failures)


def _check(rig: Rig, home: bool, linearity: bool) -> Findings:
    is_lit = yield from _tried("light", lambda: _look_at_light(rig))
    if not _is_dark(rig):
        yield Finding("FAIL", "light", "it may shine. Switch it off by hand; nothing else was tried")
        return
    yield from _tried("stage", lambda: _look_at_stage(rig, home))
    sees = yield from _tried("camera", lambda: _look_at_camera(rig, is_lit))
    if linearity and is_lit and sees:
        yield from _tried("camera", lambda: _look_at_linearity(rig))


def _is_dark(rig: Rig) -> bool:
    try:
        return not rig.light.off().lit
    except DeviceError:
        return False


def _tried(kind: str, look: Callable[[], Findings]) -> Generator[Finding, None, bool]:
    """Yield what `look` yields, and return whether it came to its end."""
    try:
        yield from look()
    except DeviceError as error:
        yield Finding("FAIL", kind, str(error))
        return False
    return True


def _look_at_light(rig: Rig) -> Findings:
    rig.light.connect()
    yield from _identified(rig, "light", rig.light.describe())
    level = max(DIM, rig.light.describe().level_limits.low)
    if not rig.light.on(level, LEASE).lit:
        raise DeviceError(f"it was told to shine at level {level:g} and reads back dark. Look at its interlock and LED")
    shone = rig.light.read()
    if not rig.light.off().lit:
        yield Finding("PASS", "light", f"shone at level {shone.level:g} and is dark again")


def _look_at_stage(rig: Rig, home: bool) -> Findings:
    rig.stage.connect()
    yield from _identified(rig, "stage", rig.stage.describe())
    if home:
        rig.stage.home()
        yield Finding("PASS", "stage", "found its zero")
    try:
        rig.stage.read()
    except NotHomedError as error:
        yield Finding("WARN", "stage", f"{error} It was not moved; `--home` lets it find its zero first")
        return
    for axis in rig.stage.describe().axes:
        yield _moved_a_little(rig, axis)


def _moved_a_little(rig: Rig, axis: AxisDescription) -> Finding:
    limits, start = axis.soft_limits, rig.stage.read()[axis.name]
    step = min(STEP, 0.05 * (limits.high - limits.low))
    target = start + step if start + step in limits else start - step
    errors = [abs(rig.stage.move({axis.name: goal})[axis.name] - goal) for goal in (target, start)]
    return Finding(
        "PASS" if max(errors) <= axis.tolerance else "FAIL",
        "stage",
        f"axis {axis.name} at {start:g} moved by {step:g} {limits.unit} and back, "
        f"{max(errors):.2g} {limits.unit} off (allowed {axis.tolerance:g})",
    )


def _look_at_camera(rig: Rig, is_lit: bool) -> Findings:
    rig.camera.connect()
    camera = rig.camera.describe()
    yield from _identified(rig, "camera", camera)
    yield _size(rig, camera)
    limits = camera.exposure_time_limits
    exposure_time = rig.camera.set_exposure_time(min(max(EXPOSURE_TIME, limits.low), limits.high))
    dark = rig.camera.trigger().counts
    yield Finding("PASS", "camera", f"took a frame of {1000 * exposure_time:g} ms, {_brightness(dark)} in the dark")
    if is_lit:
        yield _seen(dark, _lit_counts(rig))


def _look_at_linearity(rig: Rig) -> Findings:
    found = measure_linearity(rig)
    times = found.times[0] / found.times[-1]
    text = (
        f"counts are proportional to the exposure time within {100 * found.worst:.2f} ± {100 * found.sigma:.2f} % over "
        f"{times:.0f} to 1 (allowed {100 * ALLOWED:g} %); the light drifted by {100 * found.drift:.2f} % meanwhile"
    )
    if not found.is_linear:
        text += (
            f". Exposure times that are {1e6 * found.time_offset:.0f} us longer than stated would explain most of it; "
            "else look for gamma, noise reduction and contrast in the camera's own program"
        )
    yield Finding("PASS" if found.is_linear else "FAIL", "camera", text)


def _size(rig: Rig, camera: CameraDescription) -> Finding:
    wanted, size = (rig.config.camera.width, rig.config.camera.height), (camera.width, camera.height)
    if wanted == size:
        return Finding("PASS", "camera", f"delivers {size[0]} x {size[1]} pixels, {camera.bit_depth} bits")
    return Finding("FAIL", "camera", f"delivers {size[0]} x {size[1]} pixels; [camera] says {wanted[0]} x {wanted[1]}")


def _lit_counts(rig: Rig) -> Counts:
    rig.light.on(rig.config.light.level, LEASE)
    try:
        return rig.camera.trigger().counts
    finally:
        rig.light.off()


def _seen(dark: Counts, lit: Counts) -> Finding:
    """Tell whether the light is in the picture: by the brightest tenth, since a sample may be small or dark."""
    # A percentile of so many pixels is sharper than a count, whatever the noise of one.
    if np.percentile(lit, 90) - np.percentile(dark, 90) > 1.0:
        return Finding("PASS", "camera", f"sees the light: {_brightness(lit)} when it shines")
    return Finding(
        "WARN",
        "camera",
        f"sees no light when it shines ({_brightness(lit)}). Look at the lens cap, the aperture and where it points",
    )


def _brightness(counts: Counts) -> str:
    median, bright = np.percentile(counts, [50, 99])
    return f"{median:.0f} counts (brightest hundredth {bright:.0f})"


def _identified(rig: Rig, kind: str, device: CameraDescription | LightDescription | StageDescription) -> Findings:
    firmware = f", firmware {device.firmware}" if device.firmware else ""
    name = f"{device.make} {device.model}".strip()
    yield Finding("PASS", kind, f"{name}, serial number {device.serial_number}{firmware}")
    wanted = rig.config.serial_numbers.get(kind, device.serial_number)
    if wanted != device.serial_number:
        raise DeviceError(f"its serial number is {device.serial_number!r}; [{kind}] asks for {wanted!r}")
    yield from (Finding("PASS", kind, str(setting)) for setting in device.settings)
