"""Session to registered stack: merge, calibrate from the boards, resample onto the sample plane.

Frames are merged twice, once to find the boards and once to resample, so that no more than one merged
picture is in memory at a time, whatever the number of poses.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis import dictionary as dictionaries
from analysis.boards import BoardCorners, border_points, detect_corners, detection_image, white_points
from analysis.camera_calibration import CameraCalibration, calibrate_camera, usable_views
from analysis.fitting import estimate_noise
from analysis.light_calibration import LightOffset, estimate_light_offset, light_position
from analysis.merged_frames import MergedFrames
from analysis.photometry import Photometry, WhiteSamples, fit_photometry
from analysis.rectification import Grid, Rectified, View, rectify
from analysis.stack import Stack
from analysis.stages import Stages
from analysis.stated import stated
from instrument.session import Session
from instrument.validation import InvalidInputError, Problem

Array = NDArray[np.float64]

GRID_PER_PIXEL = 1.3
"""Default pitch of the grid in pixels of the picture: a mosaic does not resolve more than that."""

_BOARD_SPACING_MM, _BORDER_SPACING_MM = 0.5, 2.5
_BOARD_CLEARANCE_PX = 1.5  # blur of the picture and of the resampling, in pixels of the picture
_BORDER_CLEARANCE_MM = 4.0  # room for a sample that lies askew or is larger than the area
_ENOUGH_BORDER = 50  # points: below, the border is not white or not there, and the boards' white must do


@dataclass(frozen=True)
class Calibration:
    """What a session's own pictures say of the rig.

    Attributes
    ----------
    camera : CameraCalibration
    photometry : Photometry
    light_offset : LightOffset
    i_pose : ndarray of int, shape (n_views,)
        The session's pose of each view.
    dropped : tuple of str
        Poses that were left out, with the reason.
    """

    camera: CameraCalibration
    photometry: Photometry
    light_offset: LightOffset
    i_pose: NDArray[np.int64]
    dropped: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """Return the figures that a report shows."""
        matrix, power = self.camera.camera_matrix, self.photometry.light_power
        return {
            "n_views": len(self.i_pose),
            "dropped": list(self.dropped),
            "corner_rms_px": self.camera.rms,
            "n_corner_outliers": self.camera.n_outliers,
            "fx_px": float(matrix[0, 0]),
            "fy_px": float(matrix[1, 1]),
            "cx_px": float(matrix[0, 2]),
            "cy_px": float(matrix[1, 2]),
            "distortion": self.camera.distortion.tolist(),
            "sigma_px": self.camera.intrinsics_sigma,
            "light_offset_mm": self.light_offset.value.tolist(),
            "light_offset_sigma_mm": self.light_offset.sigma.tolist(),
            "light_power_spread": float(np.std(power) / np.mean(power)),
            "vignetting": list(self.photometry.vignetting),
            "light_gradient": list(self.photometry.gradient),
            "lobe_exponent": self.photometry.lobe_exponent,
            "white_rms": self.photometry.rms,
        }


def register(session: Session, pitch: float | None = None, stages: Stages | None = None) -> tuple[Stack, Calibration]:
    """Calibrate a session from its own pictures and resample it onto the sample plane.

    Parameters
    ----------
    session : Session
    pitch : float or None
        Size of a pixel of the stack, mm; None = as fine as the pictures.
    stages : Stages or None

    Raises
    ------
    InvalidInputError
        If there are too few poses, or too few that show the boards.
    """
    stages = stages or Stages()
    nominal = stated(session)
    frames = MergedFrames(session)
    with stages.measure("boards"):
        found = [_detect(frames, int(i), session) for i in frames.i_pose]
    usable = usable_views(found)
    dropped = tuple(
        f"pose {i}: {len(c)} board corners" for i, c, ok in zip(frames.i_pose, found, usable, strict=True) if not ok
    )
    i_pose = frames.i_pose[usable]
    with stages.measure("camera"):
        corners = [c for c, ok in zip(found, usable, strict=True) if ok]
        camera = calibrate_camera(corners, frames.image_size, nominal.focal_length_px)
    views = tuple(
        View(camera.camera_matrix, camera.distortion, R, t)
        for R, t in zip(camera.rotation, camera.translation, strict=True)
    )
    footprint = float(np.median(camera.translation[:, 2]) / camera.camera_matrix[0, 0])
    grid = Grid.covering(nominal.area_mm, pitch or round(GRID_PER_PIXEL * footprint, 3))
    with stages.measure("registration"):
        on_boards = [white_points(b, _BOARD_SPACING_MM, _BOARD_CLEARANCE_PX * footprint) for b in session.boards]
        border = border_points(session.boards, nominal.area_mm, _BORDER_SPACING_MM, _BORDER_CLEARANCE_MM)
        raw, white = _resample(frames, i_pose, views, grid, [*on_boards, border])
    prior = LightOffset(nominal.light_offset_mm, np.full(3, float(np.max(nominal.light_offset_sigma_mm))))
    with stages.measure("light"):
        light = _find_light(raw, white, views, grid, prior, frames.image_size)
        photometry = fit_photometry(white, views, light.value, frames.image_size)
    calibration = Calibration(camera, photometry, light, i_pose, dropped)
    notes = {"calibration": json.dumps(calibration.as_dict()), "session_digest": session.digest()}
    return replace(_stack(raw, photometry, light, views, grid), notes=notes), calibration


def _detect(frames: MergedFrames, i_pose: int, session: Session) -> BoardCorners:
    return detect_corners(detection_image(frames.merge(i_pose).mean, frames.bayer_pattern), session.boards)


def _resample(
    frames: MergedFrames, i_pose: NDArray[np.int64], views: tuple[View, ...], grid: Grid, whites: list[Array]
) -> tuple[list[Rectified], WhiteSamples]:
    """Resample every view onto the grid and onto the points of each white sheet; channels scaled to one white.

    The last of the `whites` is the border, which may not be white.
    """
    points, white_point = grid.points(), np.concatenate(whites)
    sheet = np.repeat(np.arange(len(whites)), [len(w) for w in whites])
    on_grid: list[Rectified] = []
    on_white: list[Rectified] = []
    for i, view in zip(i_pose, views, strict=True):
        merged = frames.merge(int(i))
        picture = (merged.mean, merged.variance, merged.saturated, frames.bayer_pattern, view)
        on_grid.append(rectify(*picture, points, grid.pitch))
        on_white.append(rectify(*picture, white_point[None], grid.pitch))
    radiance = np.stack([np.where(w.saturated[0] > 0, np.nan, w.radiance[0]) for w in on_white])
    white = _white_points(radiance, white_point, sheet, views)
    if not np.isfinite(radiance[:, white]).any():
        problem = Problem("boards", "no white of the boards is seen unclipped; add a shorter exposure to the bracket")
        raise InvalidInputError("The light cannot be calibrated.", [problem])
    # Every channel's white is made 1, so that the three may be averaged and a neutral sample is neutral.
    level = np.nanmedian(radiance[:, white], axis=(0, 1))
    relative = (radiance / level).mean(axis=-1)
    with np.errstate(invalid="ignore"):
        i_view, i_point = np.nonzero((relative > 0.0) & white)
    pixel = np.stack([w.pixels[0] for w in on_white])[i_view, i_point]
    log_radiance = np.log(relative[i_view, i_point].astype(np.float64))
    samples = WhiteSamples(log_radiance, i_view, sheet[i_point], white_point[i_point], pixel)
    return [_scaled(r, 1.0 / level) for r in on_grid], samples


def _white_points(
    radiance: NDArray[np.float32], point: Array, sheet: NDArray[np.int64], views: tuple[View, ...]
) -> NDArray[np.bool_]:
    """Tell which points are white: the border's, if it is as bright as the boards' white, else the boards'.

    The border is preferred because a board's white is narrow and takes on black from its neighbours.
    """
    on_border = sheet == sheet.max()
    camera = np.stack([-view.rotation.T @ view.translation for view in views])
    to_camera = camera[:, None] - point
    # Freed of cos / d^2 of a collocated light: close enough to tell white from anything else.
    shading = to_camera[..., 2] / np.linalg.norm(to_camera, axis=-1) ** 3
    brightness = radiance.mean(axis=-1) / shading
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a point that no view sees is no white point
        ratio = brightness / np.nanmedian(brightness[:, ~on_border], axis=1, keepdims=True)
        typical = np.nanmedian(ratio, axis=0)
        white_border = on_border & (typical > 0.85) & (typical < 1.5)
    return np.asarray(white_border if white_border.sum() >= _ENOUGH_BORDER else ~on_border)


def _scaled(view: Rectified, gain: Array) -> Rectified:
    return replace(
        view,
        radiance=(view.radiance * gain).astype(np.float32),
        variance=(view.variance * gain**2).astype(np.float32),
    )


def _find_light(
    raw: list[Rectified],
    white: WhiteSamples,
    views: tuple[View, ...],
    grid: Grid,
    prior: LightOffset,
    image_size: tuple[int, int],
) -> LightOffset:
    """Find the light's offset from the sample's highlights, starting from the ruler's."""
    photometry = fit_photometry(white, views, prior.value, image_size)
    stack = _stack(raw, photometry, prior, views, grid)
    rng = np.random.default_rng(0)
    dictionary = dictionaries.parametric()
    return estimate_light_offset(stack, dictionary, estimate_noise(stack, dictionary, rng), prior, rng)


def _stack(
    raw: list[Rectified], photometry: Photometry, light: LightOffset, views: tuple[View, ...], grid: Grid
) -> Stack:
    """Free the resampled views of vignetting and lobe."""
    points = grid.points()
    corrected: Iterator[Rectified] = (
        _scaled(r, 1.0 / photometry.falloff(view, light.value, points, r.pixels)[..., None])
        for r, view in zip(raw, views, strict=True)
    )
    done = list(corrected)
    rotation = np.stack([view.rotation for view in views])
    translation = np.stack([view.translation for view in views])
    stack = Stack(
        radiance=np.stack([r.radiance for r in done]),
        variance=np.stack([r.variance for r in done]),
        saturated=np.stack([r.saturated for r in done]),
        camera_position=-np.einsum("nji,nj->ni", rotation, translation),
        light_position=np.zeros((len(views), 3)),
        light_power=photometry.light_power,
        pixel_pitch=grid.pitch,
        camera_rotation=rotation,
        light_offset=light.value,
        light_offset_sigma=light.sigma,
    )
    return replace(stack, light_position=light_position(stack, light.value))
