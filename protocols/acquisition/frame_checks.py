"""Checks frames of a bracket against each other: were they lit, do they belong together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription, Frame
from drivers.errors import DeviceError, UnsafeError
from drivers.light import LightState
from instrument.session.preview import fraction
from protocols.acquisition.shot import Shot

# A frame of which more than this share is clipped counts as clipped: a few glints are no fault of the bracket.
CLIPPED_SHARE = 1e-2

# Counts above darkness, as a mean, that a frame must be expected to have to be held against another one: darkness is
# known to about a count.
_TELLING_COUNTS = 4.0


def clips(frame: Frame, camera: CameraDescription) -> bool:
    """Return whether so much of a frame is clipped that its exposure was too long."""
    return bool(clipped_shares(frame.counts[None], camera)[0] > CLIPPED_SHARE)


def clipped_shares(counts: NDArray[np.uint16] | NDArray[np.float32], camera: CameraDescription) -> NDArray[np.float64]:
    """Return the share of each frame's pixels at the saturation level; counts (K, H, W) to shape (K,)."""
    # A whole number: to compare counts with a floating-point number takes twice as long.
    return fraction(counts >= int(np.ceil(camera.saturation_level)))


def check_order(numbers: list[int]) -> None:
    """Raise `DeviceError` unless frames of these numbers follow one another without a gap."""
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise DeviceError(f"a frame was lost or came twice: the camera numbers them {numbers}")


def check_growth(shorter: Shot, longer: Shot, darkness: tuple[float, ...], saturation_level: float) -> None:
    """Raise `DeviceError` unless two frames show the same light, as much of it as their exposure times tell.

    A frame that was left over from before may have the right number and the right exposure time.
    """
    short, long = _sample(shorter.frame), _sample(longer.frame)
    fits = long < 0.9 * saturation_level
    if not fits.any():
        return
    seen = float(short[fits].mean()) - darkness[shorter.i_exposure]
    expected = float(long[fits].mean()) - darkness[longer.i_exposure]
    expected *= shorter.frame.exposure_time / longer.frame.exposure_time
    if max(seen, expected) > _TELLING_COUNTS and not 0.5 * expected < seen < 2.0 * expected:
        raise DeviceError(
            f"the frame of {shorter.frame.exposure_time:g} s has a mean of {seen:.1f} counts above darkness where that "
            f"of {longer.frame.exposure_time:g} s tells {expected:.1f}: a frame from before, or a light that flickers"
        )


def frame_to_repeat(shots: list[Shot], darkness: tuple[float, ...], camera: CameraDescription) -> Shot:
    """Return the shot of the shortest exposure that saw something, or the one that saw most.

    Repeated after the light went off, it shows whether that is so, and costs little.
    """
    scale = camera.saturation_level - camera.black_level
    seen = [_mean(shot.frame) - darkness[shot.i_exposure] for shot in shots]
    bright = [k for k, signal in enumerate(seen) if signal > 0.01 * scale] or [int(np.argmax(seen))]
    return min((shots[k] for k in bright), key=lambda shot: shot.frame.exposure_time)


def check_lit_and_dark_again(shot: Shot, after: Frame, darkness: float, camera: CameraDescription) -> None:
    """Make sure by two frames of one exposure time that the light shone at the first and not at the second.

    A light's own word is not enough: a relay can stick, an LED can be dead behind a driver that works.

    Parameters
    ----------
    shot : Shot
        In the light.
    after : Frame
        After it went off.
    darkness : float
        Mean counts of a frame in the dark.
    camera : CameraDescription

    Raises
    ------
    UnsafeError
        If the light still shines, or if the first frame shows nothing.
    """
    scale = camera.saturation_level - camera.black_level
    lit, dark = _mean(shot.frame), _mean(after)
    if dark - darkness > max(0.5 * (lit - darkness), 0.005 * scale):
        raise UnsafeError(
            f"after the bracket the picture is still bright ({dark:.0f} counts, {lit:.0f} in the light, {darkness:.0f} "
            "in the dark), though the light says that it is off. Switch it off by hand, and shut out other light"
        )
    if not _shows_anything(shot.frame, after, camera):
        raise UnsafeError(_why_black(shot.light))


def check_darks(mean: NDArray[np.float64], camera: CameraDescription, exposure_time: float) -> None:
    """Raise `UnsafeError` if the mean dark frame, shape (H, W), counts, is bright."""
    bright = float(np.median(mean)) - camera.black_level
    if bright > 0.1 * (camera.saturation_level - camera.black_level):
        raise UnsafeError(
            f"the darks of {exposure_time:g} s are not dark: {bright:.0f} counts above the black level. "
            "Does the light shine though it says that it is off? Shut out all other light"
        )


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
