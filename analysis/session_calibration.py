"""What a session's own pictures say of its rig: lens, poses, boards, light and the light's powers.

Frames are merged as often as they are needed, so that no more than one merged picture is in memory at a
time, whatever the number of poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis import dictionary as dictionaries
from analysis.board_findings import BoardFindings, board_findings
from analysis.board_layout import BoardLayout
from analysis.boards import BoardCorners, detect_corners
from analysis.camera_calibration import MIN_VIEWS, CameraCalibration, calibrate_camera, usable_views
from analysis.fitting import estimate_noise
from analysis.flat_field import FlatField
from analysis.lens import Lens
from analysis.light_calibration import LightOffset, estimate_light_offset, light_position
from analysis.merged_frames import MergedFrames
from analysis.photometry import Photometry, WhiteSamples, fit_photometry
from analysis.radiometry import RadiometryFindings
from analysis.rectification import Grid, Rectified, View, rectify
from analysis.stack import Stack
from analysis.stages import Stages
from analysis.stated import stated
from analysis.white_samples import WhitePoints, white_samples
from instrument.session import Session

Array = NDArray[np.float64]

_FIRST_VIEWS = 10
"""Views that the lens is first found from; corners are measured through it in all of them."""

_SCOUT_PIXELS = 64  # a side, of the coarse grid that the light is found on


@dataclass(frozen=True)
class Lighting:
    """What the white beside the sample and the sample's highlights say of the light.

    Attributes
    ----------
    photometry : Photometry
    light_offset : LightOffset
    white_level : ndarray of float32, shape (n_channels,)
        Radiance of white in each channel; the stack's channels are divided by it.
    white : WhiteSamples
        What the photometry was fitted to.
    """

    photometry: Photometry
    light_offset: LightOffset
    white_level: NDArray[np.float32]
    white: WhiteSamples


@dataclass(frozen=True)
class Calibration:
    """What a session's own pictures say of the rig.

    Attributes
    ----------
    radiometry : RadiometryFindings
        How counts became radiance.
    flat : FlatField or None
        From the session's pictures of a card; None if there are none.
    camera : CameraCalibration or None
        None without boards.
    boards : BoardFindings or None
    lighting : Lighting or None
        None where no area is stated: then there is nothing to light.
    i_pose : ndarray of int, shape (n_views,)
        The session's pose of each view that shows the boards.
    dropped : tuple of str
        Poses that were left out, with the reason.
    """

    radiometry: RadiometryFindings
    flat: FlatField | None
    camera: CameraCalibration | None
    boards: BoardFindings | None
    lighting: Lighting | None
    i_pose: NDArray[np.int64]
    dropped: tuple[str, ...]

    @property
    def distance_mm(self) -> float | None:
        """Median distance of the camera from the centre of the sample, mm; None without boards."""
        if self.camera is None:
            return None
        return float(np.median(np.linalg.norm(self.camera.camera_position, axis=1)))

    def as_dict(self) -> dict[str, object]:
        """Return the figures that a report shows."""
        figures: dict[str, object] = {"n_views": len(self.i_pose), "dropped": list(self.dropped)}
        if self.camera is not None:
            figures |= _camera_figures(self.camera)
        if self.lighting is not None:
            figures |= _light_figures(self.lighting)
        return figures


def _camera_figures(camera: CameraCalibration) -> dict[str, object]:
    matrix = camera.camera_matrix
    return {
        "corner_rms_px": camera.rms,
        "n_corner_outliers": len(camera.outliers),
        "fx_px": float(matrix[0, 0]),
        "fy_px": float(matrix[1, 1]),
        "cx_px": float(matrix[0, 2]),
        "cy_px": float(matrix[1, 2]),
        "distortion": camera.distortion.tolist(),
        "sigma_px": camera.intrinsics_sigma,
        "print_sigma_mm": camera.bundle.noise.print_sigma,
    }


def _light_figures(lighting: Lighting) -> dict[str, object]:
    photometry, offset = lighting.photometry, lighting.light_offset
    return {
        "light_offset_mm": offset.value.tolist(),
        "light_offset_sigma_mm": offset.sigma.tolist(),
        "light_power_spread": float(np.std(photometry.light_power) / np.mean(photometry.light_power)),
        "light_power_sigma": float(np.sqrt(np.mean(photometry.light_power_sigma**2))),
        "vignetting": list(photometry.vignetting),
        "light_gradient": list(photometry.gradient),
        "lobe_exponent": photometry.lobe_exponent,
        "white_rms": photometry.rms,
    }


def calibrate_session(session: Session, frames: MergedFrames, stages: Stages) -> Calibration:
    """Calibrate a session from its own pictures, as far as they and what is stated of them allow.

    Parameters
    ----------
    session : Session
    frames : MergedFrames
    stages : Stages

    Raises
    ------
    InvalidInputError
        If there are boards, and too few poses show them.
    """
    camera, boards, i_pose = None, None, np.zeros(0, np.int64)
    dropped: tuple[str, ...] = ()
    if session.boards:
        with stages.measure("boards"):
            found = _find_boards(session, frames)
        usable = usable_views(found)
        dropped = tuple(
            f"pose {i}: {len(c)} board corners" for i, c, ok in zip(frames.i_pose, found, usable, strict=True) if not ok
        )
        with stages.measure("camera"):
            corners = [c for c, ok in zip(found, usable, strict=True) if ok]
            nominal = BoardLayout.nominal(session.boards)
            camera = calibrate_camera(corners, frames.image_size, nominal, session.focal_length_px, _known(session))
        boards = board_findings(camera.bundle, nominal, frozenset.union(frozenset(), *(c.legacy for c in corners)))
        i_pose = frames.i_pose[usable]
    with stages.measure("light"):
        flat = _flat_field(session, frames, camera)
        lighting = None
        if camera is not None and boards is not None and session.area_mm is not None:
            lighting = _find_light(session, frames, i_pose, camera, boards.legacy, flat)
    return Calibration(frames.findings, flat, camera, boards, lighting, i_pose, dropped)


def _known(session: Session) -> Lens | None:
    """Return the intrinsics that somebody stated; those that come from the pictures are better if there are enough."""
    matrix, distortion = session.nominal_camera_matrix, session.nominal_distortion
    few = int(session.pose_complete.sum()) < MIN_VIEWS
    if matrix is None or not few:
        return None
    return Lens.of(matrix, np.zeros(5) if distortion is None else distortion)


def _flat_field(session: Session, frames: MergedFrames, camera: CameraCalibration | None) -> FlatField | None:
    offset = np.zeros(3) if session.light_offset_mm is None else session.light_offset_mm
    focal_length = session.focal_length_px if camera is None else float(camera.camera_matrix[0, 0])
    # Without any, a field of view of 60 deg: of the card only the product over the picture is wanted then.
    return frames.flat_field(focal_length or 0.87 * max(frames.image_size), offset)


def views_of(camera: CameraCalibration) -> tuple[View, ...]:
    """Return where the camera stood in each view."""
    pairs = zip(camera.rotation, camera.translation, strict=True)
    return tuple(View(camera.camera_matrix, camera.distortion, R, t) for R, t in pairs)


def footprint_mm(camera: CameraCalibration) -> float:
    """Return the size of a pixel of the pictures on the sample, seen from straight ahead, mm."""
    return float(np.median(camera.translation[:, 2]) / camera.camera_matrix[0, 0])


def _find_boards(session: Session, frames: MergedFrames) -> list[BoardCorners]:
    """Find the corners twice in a few views, to know the lens, and then through it in all."""
    lens = _first_lens(session, frames)
    return [_detect(session, frames, int(i), lens) for i in frames.i_pose]


def _first_lens(session: Session, frames: MergedFrames) -> Lens | None:
    picked = frames.i_pose[np.unique(np.linspace(0, len(frames.i_pose) - 1, _FIRST_VIEWS).round().astype(int))]
    found = [c for i in picked if usable_views([c := _detect(session, frames, int(i), None)])[0]]
    if len(found) < MIN_VIEWS:
        return None
    layout = BoardLayout.nominal(session.boards)
    return calibrate_camera(found, frames.image_size, layout, session.focal_length_px).bundle.state.lens


def _detect(session: Session, frames: MergedFrames, i_pose: int, lens: Lens | None) -> BoardCorners:
    merged = frames.merge(i_pose)
    picture = np.where(merged.saturated, np.float32(np.nan), merged.mean)
    # Boards are black and white: the mean of the colours shows them with the least noise.
    grey = picture.mean(axis=-1) if picture.ndim == 3 else picture
    return detect_corners(grey, frames.bayer_pattern, session.boards, lens)


def _find_light(
    session: Session,
    frames: MergedFrames,
    i_pose: NDArray[np.int64],
    camera: CameraCalibration,
    legacy: frozenset[int],
    flat: FlatField | None,
) -> Lighting:
    """Find powers and fall-off from the white, and the light's offset from the sample's highlights.

    The offset is sought on a coarse grid of the area, since a few hundred pixels tell it.
    """
    nominal = stated(session)
    views, footprint = views_of(camera), footprint_mm(camera)
    white = WhitePoints.beside(session.boards, legacy, nominal.area_mm, footprint)
    scout = _scout_grid(nominal.area_mm, footprint)
    on_scout, on_white = [], []
    for i, view in zip(i_pose, views, strict=True):
        merged = frames.merge(int(i))
        picture = (merged.mean, merged.variance, merged.saturated, frames.bayer_pattern, view)
        on_scout.append(evened(rectify(*picture, scout.points(), footprint), flat, view, scout.points()))
        on_white.append(evened(rectify(*picture, white.points[None], footprint), flat, view, white.points[None]))
    samples, level = white_samples(on_white, white, views)
    prior = LightOffset(nominal.light_offset_mm, np.full(3, float(np.max(nominal.light_offset_sigma_mm))))
    first = fit_photometry(samples, views, prior.value, frames.image_size)
    stack = _scout_stack([r.scaled(1.0 / level) for r in on_scout], first, prior, camera, scout)
    rng = np.random.default_rng(0)
    dictionary = dictionaries.parametric()
    light = estimate_light_offset(stack, dictionary, estimate_noise(stack, dictionary, rng), prior, rng)
    return Lighting(fit_photometry(samples, views, light.value, frames.image_size), light, level, samples)


def evened(seen: Rectified, flat: FlatField | None, view: View, points: Array) -> Rectified:
    """Divide a view by the flat field, if there is one; what that leaves, the white beside the sample tells."""
    if flat is None:
        return seen
    return seen.scaled(1.0 / flat.gain_at(seen.pixels, points @ view.rotation.T + view.translation)[..., None])


def _scout_grid(area_mm: tuple[float, float], footprint: float) -> Grid:
    return Grid.covering(area_mm, max(max(area_mm) / _SCOUT_PIXELS, footprint))


def _scout_stack(
    seen: Sequence[Rectified], photometry: Photometry, light: LightOffset, camera: CameraCalibration, grid: Grid
) -> Stack:
    points = grid.points()
    freed = [
        r.scaled(1.0 / photometry.falloff(view, light.value, points, r.pixels)[..., None])
        for r, view in zip(seen, views_of(camera), strict=True)
    ]
    return replace(
        stack_geometry(photometry, light, camera, grid, freed[0].radiance.shape[-1]),
        radiance=np.stack([r.radiance for r in freed]),
        variance=np.stack([r.variance for r in freed]),
        saturated=np.stack([r.saturated for r in freed]),
    )


def stack_geometry(
    photometry: Photometry, light: LightOffset, camera: CameraCalibration, grid: Grid, n_channels: int
) -> Stack:
    """Return a stack whose pictures are still to come: one NaN and one 0, seen everywhere, stand in for them."""
    views, border = views_of(camera), _border(grid)
    shape = (len(views), grid.height, grid.width, n_channels)
    stack = Stack(
        radiance=np.broadcast_to(np.float32(np.nan), shape),
        variance=np.broadcast_to(np.float32(np.nan), shape),
        saturated=np.broadcast_to(np.uint8(0), shape),
        camera_position=camera.camera_position,
        light_position=np.zeros((len(views), 3)),
        light_power=photometry.light_power,
        pixel_pitch=grid.pitch,
        camera_rotation=camera.rotation,
        light_offset=light.value,
        light_offset_sigma=light.sigma,
        light_power_sigma=photometry.light_power_sigma,
        registration_sigma=camera.registration_sigma(border),
        falloff_sigma=float(np.median([photometry.falloff_sigma(v, light.value, border) for v in views])),
    )
    return replace(stack, light_position=light_position(stack, light.value))


def _border(grid: Grid) -> Array:
    """Return the corners and the middles of the sides of the area, sample frame, mm, shape (8, 3)."""
    half = 0.5 * grid.pitch * np.array([grid.width, grid.height])
    around = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]
    return np.pad(np.array(around, np.float64) * half, ((0, 0), (0, 1)))
