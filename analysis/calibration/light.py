"""The light of a session: powers and fall-off from the white beside the sample, its place from the highlights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.nominal import nominal_setup
from analysis.camera.calibration import CameraCalibration, footprint_mm, views_of
from analysis.camera.view import View
from analysis.light.flat_field import FlatField
from analysis.light.offset import estimate_light_offset
from analysis.light.photometry import Photometry, WhiteSamples, fit_photometry
from analysis.light.white import WhitePoints, white_samples
from analysis.pixels.problem import estimate_noise
from analysis.radiometry.frames import MergedFrames
from analysis.reflectance import dictionary as dictionaries
from analysis.registration.grid import Grid
from analysis.registration.lighting import LightOffset, light_position
from analysis.registration.rectification import Rectified, rectify
from analysis.registration.stack import Stack
from analysis.stages import Track, untracked
from instrument.session.session import Session

Array = NDArray[np.float64]

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


def find_light(
    session: Session,
    frames: MergedFrames,
    i_pose: NDArray[np.int64],
    camera: CameraCalibration,
    legacy: frozenset[int],
    flat: FlatField | None,
    track: Track = untracked,
) -> Lighting:
    """Find powers and fall-off from the white, and the light's offset from the sample's highlights.

    The offset is sought on a coarse grid of the area, since a few hundred pixels tell it.
    """
    nominal = nominal_setup(session)
    views, footprint = views_of(camera), footprint_mm(camera)
    white = WhitePoints.beside(session.nominal.boards, camera.bundle.state.layout, legacy, nominal.area_mm, footprint)
    scout = _scout_grid(nominal.area_mm, footprint)
    on_scout, on_white = [], []
    for i, view in track(list(zip(i_pose, views, strict=True))):
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
