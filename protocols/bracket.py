"""Takes the frames of one pose, and believes nothing that the devices do not confirm."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.camera import Camera, CameraDescription, Frame
from drivers.errors import DeviceError, UnsafeError
from drivers.light import Light, LightState
from drivers.stage import Stage
from instrument.pose_record import PoseRecord
from instrument.rig import Rig
from protocols.reference import ReferencePatch

# A camera rounds exposure times to its clock; more than 2 % off is another time than planned.
SETTING_TOLERANCE = 0.02
# A frame must carry the time that was read back, but for the last digits of its metadata.
FRAME_TOLERANCE = 1e-3
# Seconds of lease a frame may take besides its exposure: readout, transfer, a busy computer.
LEASE_MARGIN = 2.0
# Counts above darkness, as a mean, that a frame must be expected to have to be held against another one: darkness is
# known to about a count.
_TELLING_COUNTS = 4.0
# A frame of which more than this share is clipped counts as clipped: a few glints are no fault of the bracket.
CLIPPED_SHARE = 1e-2


@dataclass(frozen=True, slots=True)
class Bracket:
    """The exposures of every pose, and what is known for checking them.

    Attributes
    ----------
    times : tuple of float, length E
        Seconds, ascending.
    n_spare : int
        The first so many are taken only where the next one clips.
    darkness : tuple of float, length E
        Mean counts of a frame in the dark, per exposure time.
    """

    times: tuple[float, ...]
    n_spare: int
    darkness: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Shot:
    """One frame with what the light said and when it had been read (monotonic, ns)."""

    i_exposure: int
    frame: Frame
    light: LightState
    monotonic_ns: int


def take_pose(
    rig: Rig, target: Mapping[str, float], bracket: Bracket, attempt: int, patch: ReferencePatch | None = None
) -> PoseRecord:
    """Move to `target`, take the bracket in the light, and make sure that it was lit and is dark again.

    Parameters
    ----------
    rig : Rig
    target : mapping of str to float
        Position of each axis, degrees or millimetres.
    bracket : Bracket
    attempt : int
        How often this pose was begun, for the record.
    patch : ReferencePatch, optional
        Where to read the drift from.

    Raises
    ------
    DeviceError
        If any device fails or does not confirm what it was told; the light was told to go off then.
    """
    positions = move_verified(rig.stage, target)
    return _record(rig, take_bracket(rig, bracket), positions, attempt, patch)


def take_bracket(rig: Rig, bracket: Bracket) -> list[Shot]:
    """Take the bracket where the stage stands, in the light; return its shots, exposure times ascending.

    Raises
    ------
    DeviceError
        As `take_pose`.
    """
    with light_on(rig.light, rig.config.light.level, lease_seconds(bracket.times)):
        shots = _take_shots(rig, bracket)
    _check_order([shot.frame.sequence_number for shot in shots])
    shots.sort(key=lambda shot: shot.i_exposure)
    for shorter, longer in pairwise(shots):
        _check_growth(shorter, longer, bracket, rig.camera.describe().saturation_level)
    _check_lit_and_dark_again(rig, shots, bracket)
    return shots


def clips(frame: Frame, camera: CameraDescription) -> bool:
    """Return whether so much of a frame is clipped that its exposure was too long."""
    return bool((frame.counts >= camera.saturation_level).mean() > CLIPPED_SHARE)


def take_darks(
    rig: Rig, exposure_time: float, count: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], int, float]:
    """Take `count` frames in the dark.

    Returns
    -------
    mean, variance : ndarray of float32, shape (H, W)
        Of the counts; the variance is that of one frame (divided by ``count - 1``).
    monotonic_ns : int
        When the last had been read.
    temperature : float
        Of the sensor at the last, degrees Celsius.

    Raises
    ------
    UnsafeError
        If the frames are not dark.
    """
    _confirm_dark(rig.light)
    camera = rig.camera.describe()
    shape = camera.height, camera.width
    total, squares = np.zeros(shape, np.uint64), np.zeros(shape, np.uint64)
    numbers = []
    for _ in range(count):
        frame = _expose(rig.camera, exposure_time)
        numbers.append(frame.sequence_number)
        counts = frame.counts.astype(np.uint64)
        # Sums of whole numbers are exact; the stack of frames need not be kept.
        total += counts
        squares += counts * counts
    _check_order(numbers)
    mean = total / count
    variance = np.maximum(squares - total * mean, 0.0) / (count - 1)
    _check_darks(mean, camera, exposure_time)
    return mean.astype(np.float32), variance.astype(np.float32), time.monotonic_ns(), frame.sensor_temperature


def take_flats(rig: Rig, exposure_time: float, count: int) -> NDArray[np.uint16]:
    """Take `count` frames of what lies before the lens, in the light; shape (count, H, W), counts.

    Raises
    ------
    DeviceError
        If a device fails.
    UnsafeError
        If they clip.
    """
    times = (exposure_time,) * count
    with light_on(rig.light, rig.config.light.level, lease_seconds(times)):
        shots = [take_shot(rig.camera, rig.light, 0, exposure_time) for _ in times]
    _check_order([shot.frame.sequence_number for shot in shots])
    if clips(shots[0].frame, rig.camera.describe()):
        raise UnsafeError(f"the flat frames of {exposure_time:g} s clip. Choose a shorter flats.exposure_time_s")
    return np.stack([shot.frame.counts for shot in shots])


def move_verified(stage: Stage, target: Mapping[str, float]) -> dict[str, float]:
    """Move, and return every axis' read-back once it lies within tolerance of its target."""
    stage.move(target)
    positions = stage.read()
    for axis in stage.describe().axes:
        wanted, reached = target.get(axis.name), positions[axis.name]
        # Written so that a NaN fails.
        if wanted is not None and not abs(reached - wanted) <= axis.tolerance:
            raise DeviceError(
                f"axis {axis.name!r} reads {reached:g} {axis.soft_limits.unit} and should be at {wanted:g} "
                f"within {axis.tolerance:g}. Look for an obstacle or a loose belt"
            )
    return positions


@contextmanager
def light_on(light: Light, level: float, max_seconds: float) -> Iterator[None]:
    """Light within the block, dark after it; both confirmed by the light itself."""
    try:
        if not light.on(level, max_seconds).lit:
            raise DeviceError("the light was told to shine and reports that it is dark. Check its supply")
        yield
    except BaseException as error:
        # What went wrong first stays the error, above all a Ctrl-C.
        _darken(light, error)
        raise
    _confirm_dark(light)


def _darken(light: Light, error: BaseException) -> None:
    try:
        light.off()
    except Exception as failure:
        error.add_note(f"light off failed: {failure}")


def _confirm_dark(light: Light) -> None:
    # A second command, in case that the first was lost on its way.
    if light.off().lit and light.off().lit:
        raise UnsafeError("the light was told to go dark twice and still shines. Switch it off by hand")


def take_shot(camera: Camera, light: Light, i_exposure: int, exposure_time: float) -> Shot:
    """Take one frame of `exposure_time` seconds in the light."""
    frame = _expose(camera, exposure_time)
    state = light.read()
    if not state.lit:
        raise DeviceError("the light went dark during the bracket: its lease ended or its supply failed")
    return Shot(i_exposure, frame, state, time.monotonic_ns())


def _take_shots(rig: Rig, bracket: Bracket) -> list[Shot]:
    """Return the shots in the order they were taken."""
    regular = range(bracket.n_spare, len(bracket.times))
    shots = [take_shot(rig.camera, rig.light, i, bracket.times[i]) for i in regular]
    if bracket.n_spare and clips(shots[0].frame, rig.camera.describe()):
        shots += [take_shot(rig.camera, rig.light, i, bracket.times[i]) for i in range(bracket.n_spare)]
    return shots


def lease_seconds(exposure_times: tuple[float, ...]) -> float:
    """Return for how many seconds the light may shine by itself over a bracket."""
    return sum(exposure_times) + LEASE_MARGIN * len(exposure_times)


def _check_order(numbers: list[int]) -> None:
    """Raise `DeviceError` unless frames of these numbers follow one another without a gap."""
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise DeviceError(f"a frame was lost or came twice: the camera numbers them {numbers}")


def _check_growth(shorter: Shot, longer: Shot, bracket: Bracket, saturation_level: float) -> None:
    """Raise `DeviceError` unless two frames show the same light, as much of it as their exposure times tell.

    A frame that was left over from before may have the right number and the right exposure time.
    """
    short, long = _sample(shorter.frame), _sample(longer.frame)
    fits = long < 0.9 * saturation_level
    if not fits.any():
        return
    seen = float(short[fits].mean()) - bracket.darkness[shorter.i_exposure]
    expected = float(long[fits].mean()) - bracket.darkness[longer.i_exposure]
    expected *= shorter.frame.exposure_time / longer.frame.exposure_time
    if max(seen, expected) > _TELLING_COUNTS and not 0.5 * expected < seen < 2.0 * expected:
        raise DeviceError(
            f"the frame of {shorter.frame.exposure_time:g} s has a mean of {seen:.1f} counts above darkness where that "
            f"of {longer.frame.exposure_time:g} s tells {expected:.1f}: a frame from before, or a light that flickers"
        )


def _check_lit_and_dark_again(rig: Rig, shots: list[Shot], bracket: Bracket) -> None:
    """Take one more frame, and make sure by the pictures that the light shone and that it went out.

    A light's own word is not enough: a relay can stick, an LED can be dead behind a driver that works. The frame
    repeats the shortest exposure that saw something, so it costs little.

    Raises
    ------
    UnsafeError
        If the light still shines, or if the bracket shows nothing.
    """
    camera = rig.camera.describe()
    scale = camera.saturation_level - camera.black_level
    seen = [_mean(shot.frame) - bracket.darkness[shot.i_exposure] for shot in shots]
    bright = [k for k, signal in enumerate(seen) if signal > 0.01 * scale] or [int(np.argmax(seen))]
    shot = min((shots[k] for k in bright), key=lambda shot: bracket.times[shot.i_exposure])
    after = _expose(rig.camera, bracket.times[shot.i_exposure])
    lit, dark = _mean(shot.frame), _mean(after)
    darkness = bracket.darkness[shot.i_exposure]
    if dark - darkness > max(0.5 * (lit - darkness), 0.005 * scale):
        _confirm_dark(rig.light)
        raise UnsafeError(
            f"after the bracket the picture is still bright ({dark:.0f} counts, {lit:.0f} in the light, {darkness:.0f} "
            "in the dark), though the light says that it is off. Switch it off by hand, and shut out other light"
        )
    if not _shows_anything(shot.frame, after, camera):
        raise UnsafeError(_why_black(shot.light))


def _shows_anything(lit: Frame, dark: Frame, camera: CameraDescription) -> bool:
    """Return whether a frame in the light has anything that the one in the dark has not."""
    noise = camera.read_noise / camera.conversion_gain
    noise = noise if np.isfinite(noise) else 1.0
    brightest = float(np.quantile(_sample(lit), 0.999)) - float(np.quantile(_sample(dark), 0.999))
    return bool(brightest > 3.0 * noise or _mean(lit) - _mean(dark) > 0.5 * noise)


def _mean(frame: Frame) -> float:
    return float(_sample(frame).mean())


def _sample(frame: Frame) -> NDArray[np.uint16]:
    """Return a ninth of the pixels, of all colours, which tells light from dark as well and costs no time."""
    return frame.counts[::3, ::3]


def _why_black(light: LightState) -> str:
    if light.monitor > 0.0:
        return "the picture is black though the light's own monitor sees it shine. Is the lens cap on?"
    return "the picture is black. Is the lens cap on, is the light dead, does its fibre sit?"


def _check_darks(mean: NDArray[np.float64], camera: CameraDescription, exposure_time: float) -> None:
    bright = float(np.median(mean)) - camera.black_level
    if bright > 0.1 * (camera.saturation_level - camera.black_level):
        raise UnsafeError(
            f"the darks of {exposure_time:g} s are not dark: {bright:.0f} counts above the black level. "
            "Does the light shine though it says that it is off? Shut out all other light"
        )


def _expose(camera: Camera, exposure_time: float) -> Frame:
    readback = camera.set_exposure_time(exposure_time)
    _check_close("the camera's exposure time", readback, exposure_time, SETTING_TOLERANCE)
    frame = camera.trigger()
    _check_close("the frame's exposure time", frame.exposure_time, readback, FRAME_TOLERANCE)
    _check_frame(frame, camera.describe())
    return frame


def _check_frame(frame: Frame, camera: CameraDescription) -> None:
    """Raise `DeviceError` unless the frame has the shape and type that the camera describes."""
    expected = (camera.height, camera.width)
    if frame.counts.shape != expected or frame.counts.dtype != np.uint16:
        raise DeviceError(
            f"the camera delivered {frame.counts.dtype} of shape {frame.counts.shape}; "
            f"expected uint16 of shape {expected}"
        )


def _check_close(what: str, value: float, wanted: float, tolerance: float) -> None:
    # Written so that a NaN fails.
    if not abs(value - wanted) <= tolerance * wanted:
        raise DeviceError(
            f"{what} is {value:g} s and should be {wanted:g} s (within {tolerance:.1%}): "
            "a setting that did not take, or a frame of the exposure before"
        )


def _record(
    rig: Rig,
    shots: list[Shot],
    positions: Mapping[str, float],
    attempt: int,
    patch: ReferencePatch | None,
) -> PoseRecord:
    counts = np.stack([shot.frame.counts for shot in shots])
    times = np.array([shot.frame.exposure_time for shot in shots])
    return PoseRecord(
        i_exposure=np.array([shot.i_exposure for shot in shots]),
        counts=counts,
        exposure_readback=times,
        sensor_temperature=np.array([shot.frame.sensor_temperature for shot in shots]),
        monotonic_ns=np.array([shot.monotonic_ns for shot in shots]),
        level_set=rig.config.light.level,
        level_readback=np.array([shot.light.level for shot in shots]),
        monitor=np.array([shot.light.monitor for shot in shots]),
        light_temperature=np.array([shot.light.temperature for shot in shots]),
        positions=positions,
        attempts=attempt,
        reference=np.nan if patch is None else patch.brightness(counts, times, positions),
    )
