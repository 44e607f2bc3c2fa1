"""Checks that the sample was not moved since a session was interrupted, by a frame of a captured pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription
from drivers.errors import UnsafeError
from instrument.rig.rig import Rig
from instrument.session.session import Session
from protocols.acquisition.frame_checks import CLIPPED_SHARE
from protocols.acquisition.shot import lease_seconds, light_on, move_verified, take_shot

# Both in standard deviations and shares: noise alone takes 6e-5 of the pixels beyond four sigmas.
_SIGMAS, _MAX_SHARE = 4.0, 0.02

# A stage that comes back is as good as its tolerance: edges may lie a pixel off.
_STAGE_PIXELS = 1.0

# The light of another day is not the same; more than this is told.
_LIGHT_CHANGE = 0.1


@dataclass(frozen=True, slots=True)
class Landmark:
    """One frame of a complete pose, to compare with.

    Attributes
    ----------
    i_pose : int
    target : mapping of str to float
        Where the stage stood.
    exposure_time : float
        Seconds.
    counts : ndarray of uint16, shape (H, W)
    """

    i_pose: int
    target: Mapping[str, float]
    exposure_time: float
    counts: NDArray[np.uint16]

    @classmethod
    def of(cls, session: Session, targets: Mapping[str, tuple[float, ...]]) -> Landmark | None:
        """Return the last complete pose's longest exposure that does not clip; None if no pose is complete."""
        complete = np.flatnonzero(session.pose_complete)
        if not complete.size:
            return None
        i_pose = int(complete[-1])
        usable = session.frame_ok[i_pose] & (session.saturated_fraction[i_pose] <= CLIPPED_SHARE)
        i_exposure = (
            int(np.flatnonzero(usable)[-1]) if usable.any() else int(np.flatnonzero(session.frame_ok[i_pose])[0])
        )
        target = {axis: positions[i_pose] for axis, positions in targets.items()}
        return cls(i_pose, target, float(session.exposure_times[i_exposure]), session.frame(i_pose, i_exposure))


def check_not_moved(rig: Rig, landmark: Landmark) -> float:
    """Take the landmark's frame again and compare.

    Returns
    -------
    float
        Brightness of now over that of then.

    Raises
    ------
    UnsafeError
        If more of the picture differs than noise and the stage's tolerance explain.
    DeviceError
        If a device fails.
    """
    move_verified(rig.stage, landmark.target)
    with light_on(rig.light, rig.config.light.level, lease_seconds((landmark.exposure_time,))):
        shot = take_shot(rig.camera, rig.light, 0, landmark.exposure_time)
    scale, share = difference(landmark.counts, shot.frame.counts, rig.camera.describe())
    if share > _MAX_SHARE:
        raise UnsafeError(
            f"pose {landmark.i_pose} looks different now: {share:.0%} of the picture changed by more than noise and a "
            f"pixel of motion explain (allowed {_MAX_SHARE:.0%}). Was the sample moved? Capture anew, or put it "
            "back; to go on all the same: halfangle resume --accept-moved"
        )
    return scale


def light_changed(scale: float) -> str:
    """Return a warning if the brightness changed by much since then, else nothing."""
    if abs(scale - 1.0) <= _LIGHT_CHANGE:
        return ""
    return f"the light is {scale:.2f} times as bright as before the interruption"


def difference(then: NDArray[np.uint16], now: NDArray[np.uint16], camera: CameraDescription) -> tuple[float, float]:
    """Compare two frames of one pose and exposure, shape (H, W), counts.

    Returns
    -------
    scale : float
        Brightness of `now` over that of `then`.
    share : float
        Share of the 2 x 2 cells that differ by more than noise, and a motion by a pixel, explain.
    """
    a, b = (_cells(counts) - camera.black_level for counts in (then, now))
    usable = np.maximum(a, b) < 0.9 * (camera.saturation_level - camera.black_level)
    if not usable.any():
        return 1.0, 0.0
    scale = float(np.sum(a[usable] * b[usable]) / max(float(np.sum(a[usable] ** 2)), 1e-12))
    # Var of a cell's mean of four counts: shot noise (signal / gain) and read noise, of both frames; a quantised
    # count has 1/12 at least.
    gain = camera.conversion_gain if np.isfinite(camera.conversion_gain) else 1.0
    read = camera.read_noise / gain if np.isfinite(camera.read_noise) else 1.0
    variance = 2.0 * (np.maximum(a, 0.0) / gain + read**2 + 1.0 / 12.0) / 4.0
    rows, columns = np.gradient(a)
    # A cell is two pixels wide.
    variance += (0.5 * _STAGE_PIXELS) ** 2 * (rows**2 + columns**2) + (0.01 * a) ** 2
    changed = np.abs(b - scale * a) > _SIGMAS * np.sqrt(variance)
    return scale, float(changed[usable].mean())


def _cells(counts: NDArray[np.uint16]) -> NDArray[np.float64]:
    height, width = (size // 2 * 2 for size in counts.shape)
    cells = counts[:height, :width].reshape(height // 2, 2, width // 2, 2)
    return np.asarray(cells.mean(axis=(1, 3), dtype=np.float64))
