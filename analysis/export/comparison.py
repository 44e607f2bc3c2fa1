"""How far pictures of exported maps are from the project's own render, by the difference angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.drawing.colour_difference import ciede2000, lab_from_srgb
from analysis.drawing.colours import display_colours
from analysis.export.maps import Prepared, SurfaceMaps, resized
from analysis.export.microfacet import evaluate
from analysis.reflectance.models import Cosines

Array = NDArray[np.float64]

ANGLES_DEG = ((0.0, 0.0), (0.0, 20.0), (0.0, 40.0), (0.0, 60.0), (30.0, 60.0))
"""Camera and light from the normal of the mean plane, on opposite sides: theta_d is half their sum."""

_AZIMUTH_DEG = 30.0  # neither along rows nor along columns, so that either one turned round shows

_DISTANCE = 5.0  # times the longer side

_MAX_PIXELS = 200_000  # about: of a larger area, every second or third and so on tells the same


@dataclass(frozen=True, slots=True)
class ViewError:
    """One pair of pictures, made alike for display: the 99th percentile of the render is white.

    Attributes
    ----------
    camera_deg, light_deg, theta_d_deg : float
    psnr_db : float
    delta_e : float
        Mean CIEDE2000.
    """

    camera_deg: float
    light_deg: float
    theta_d_deg: float
    psnr_db: float
    delta_e: float


def compare(prepared: Prepared, written: SurfaceMaps) -> tuple[ViewError, ...]:
    """Compare pictures of maps with the render of the result that they were made of.

    Parameters
    ----------
    prepared : Prepared
    written : SurfaceMaps
        The maps as a file holds them.
    """
    solved = np.flatnonzero(written.solved)
    pixels = solved[:: max(len(solved) // _MAX_PIXELS, 1)]
    return tuple(_view_error(prepared, written, pixels, camera, light) for camera, light in ANGLES_DEG)


def position(angle_deg: float, size_mm: tuple[float, float]) -> Array:
    """Return a place `angle_deg` from the normal over the middle of an area, mm."""
    angle, azimuth = np.deg2rad([angle_deg, _AZIMUTH_DEG])
    direction = np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])
    return _DISTANCE * max(size_mm) * direction


def render(prepared: Prepared, pixels: NDArray[np.int64], camera: Array, light: Array) -> Array:
    """Return the project's own picture, times the scale, of some pixels of the maps, shape (N, 3); NaN if unsolved."""
    result, maps = prepared.result, prepared.maps
    if maps.shape == (result.grid.height, result.grid.width):
        points = result.grid.points_of(pixels, np.nan_to_num(result.depth))
        picture = result.fits.select(pixels).radiance(points, camera, light)
    else:
        picture = _averaged(result.render(camera, light), maps.shape)[pixels]
    return np.asarray(np.broadcast_to(prepared.scale.factor * picture, (len(pixels), 3)))


def _averaged(picture: Array, shape: tuple[int, int]) -> Array:
    """Return the mean over what is known of a picture within each pixel of a coarser one, in reading order."""
    height, width = shape
    share = resized(np.isfinite(picture).astype(np.float64), (width, height))
    total = resized(np.nan_to_num(picture), (width, height))
    mean = np.where(share >= 0.5, total / np.where(share > 0.0, share, 1.0), np.nan)
    return mean.reshape(-1, picture.shape[-1])


def shade(maps: SurfaceMaps, pixels: NDArray[np.int64], camera: Array, light: Array) -> Array:
    """Return the picture of some pixels by the portable model's formulas, (N, 3), as `Result.render` makes its own."""
    points, normals = maps.points().reshape(-1, 3)[pixels], maps.normals.reshape(-1, 3)[pixels]
    to_light, to_camera = light - points, camera - points
    d2 = np.sum(to_light**2, axis=-1)
    omega_i = to_light / np.sqrt(d2)[:, None]
    omega_o = to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
    n_dot_l, n_dot_v = (np.sum(normals * omega, axis=-1) for omega in (omega_i, omega_o))
    lit = np.where(n_dot_v > 0.0, np.maximum(n_dot_l, 0.0), 0.0) / d2
    f = evaluate(maps.surfaces.select(pixels), Cosines.from_directions(normals, omega_i, omega_o))
    return np.asarray(f * lit[:, None])


def _view_error(
    prepared: Prepared, written: SurfaceMaps, pixels: NDArray[np.int64], camera_deg: float, light_deg: float
) -> ViewError:
    camera, light = position(-camera_deg, written.size_mm), position(light_deg, written.size_mm)
    expected, found = render(prepared, pixels, camera, light), shade(written, pixels, camera, light)
    known = np.isfinite(expected).all(axis=-1)
    white = float(np.percentile(expected[known], 99.0))
    first, second = (display_colours(picture[known], white) for picture in (expected, found))
    error = float(np.mean((first - second) ** 2))
    return ViewError(
        camera_deg=camera_deg,
        light_deg=light_deg,
        theta_d_deg=0.5 * (camera_deg + light_deg),
        psnr_db=float(-10.0 * np.log10(max(error, 1e-12))),
        delta_e=float(np.mean(ciede2000(lab_from_srgb(first), lab_from_srgb(second)))),
    )
