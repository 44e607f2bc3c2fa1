"""The maps of a result in the portable surface model, on its grid, on a part of it or averaged to a coarser one."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from analysis.export.microfacet import MAX_DIELECTRIC_F0, Surfaces
from analysis.export.options import TITLE, Crop
from analysis.export.pixels import PixelSurfaces, pixel_surfaces
from analysis.export.scale import Scale, reflectance_scale
from analysis.palette.materials import materials_used
from analysis.pixels.fits import PixelFits
from analysis.registration.grid import Grid
from analysis.results.result import Result
from instrument.files.validation import InvalidInputError, Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Counts:
    """What became of the pixels of an export.

    Attributes
    ----------
    n_pixels, n_unsolved : int
    n_outside_palette : int
        Solved ones that are fitted on their own: all where a result has no palette.
    n_clipped : int
        Those whose colour would be above 1 at the scale that was taken.
    n_dull : int
        Dielectrics whose highlight is as strong as their F0 may be: the measured one may be stronger.
    n_classes : int
        Fits that the pixels of the palette share.
    fit_error_median, fit_error_p95 : float
        Of the surface model against the result's BRDF, relative.
    """

    n_pixels: int
    n_unsolved: int
    n_outside_palette: int
    n_clipped: int
    n_dull: int
    n_classes: int
    fit_error_median: float
    fit_error_p95: float


@dataclass(frozen=True)
class SurfaceMaps:
    """An area as renderers know it, H x W pixels, row 0 at the top; a pixel that was not solved has its neighbour's.

    Attributes
    ----------
    size_mm : (float, float)
        Width and height of the area.
    surfaces : Surfaces
        Of the H * W pixels in reading order.
    normals : ndarray, shape (H, W, 3)
        Unit vectors, sample frame; (0, 0, 1) where unsolved.
    displacement : ndarray, shape (H, W)
        Height along z about the mean plane, mm.
    normal_sigma_deg : ndarray, shape (H, W)
        NaN where unsolved.
    material_shares : ndarray, shape (H, W, K)
        Shares of the palette's materials, their sum 1; 0 in pixels outside the palette.
    solved : ndarray of bool, shape (H, W)
    """

    size_mm: tuple[float, float]
    surfaces: Surfaces
    normals: Array
    displacement: Array
    normal_sigma_deg: Array
    material_shares: Array
    solved: NDArray[np.bool_]

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.solved.shape[0], self.solved.shape[1]

    def points(self) -> Array:
        """Return the centres of the pixels in mm, origin in the middle of the mean plane, shape (H, W, 3)."""
        height, width = self.shape
        x = ((np.arange(width) + 0.5) / width - 0.5) * self.size_mm[0]
        y = (0.5 - (np.arange(height) + 0.5) / height) * self.size_mm[1]
        xx, yy = np.meshgrid(x, y)
        return np.stack([xx, yy, self.displacement], axis=-1)


@dataclass(frozen=True)
class Prepared:
    """A result ready to be written.

    Attributes
    ----------
    result : Result
        The part that is exported, its frame's origin in the middle of it.
    maps : SurfaceMaps
    scale : Scale
    counts : Counts
    """

    result: Result
    maps: SurfaceMaps
    scale: Scale
    counts: Counts


def prepare(
    result: Result, crop: Crop | None = None, resolution: int | None = None, white_reflectance: float | None = None
) -> Prepared:
    """Bring a result into the portable surface model.

    Parameters
    ----------
    result : Result
    crop : Crop, optional
    resolution : int, optional
        Pixels of the longer side; maps are averaged to it.
    white_reflectance : float, optional
        Of what the result takes for 1; without it a scale is chosen, and stated.

    Raises
    ------
    InvalidInputError
        If no pixel is solved, the part is not within the area, or there are fewer pixels than the resolution.
    """
    _check(result, crop, resolution)
    part = result if crop is None else cropped(result, crop)
    solved = np.isfinite(part.fits.normals[:, 0])
    if not solved.any():
        raise InvalidInputError(TITLE, [Problem("result", "no pixel of it is solved; choose another part or result")])
    scale = reflectance_scale(result, white_reflectance)
    fits = part.fits if solved.all() else part.fits.select(np.flatnonzero(solved))
    found = pixel_surfaces(fits, scale.factor)
    maps = _maps(part, fits, found, solved)
    if resolution is not None:
        maps = _averaged(maps, resolution)
    return Prepared(part, maps, scale, _counts(found, solved))


def _check(result: Result, crop: Crop | None, resolution: int | None) -> None:
    width, height = result.grid.width, result.grid.height
    if crop is not None:
        if crop.x < 0 or crop.y < 0 or crop.x + crop.width > width or crop.y + crop.height > height:
            what = f"is {crop.x},{crop.y},{crop.width},{crop.height}; the area has {width} x {height} pixels"
            raise InvalidInputError(TITLE, [Problem("--crop", what)])
        width, height = crop.width, crop.height
    if resolution is not None and resolution > max(width, height):
        what = f"is {resolution}; no more than {max(width, height)} pixels were measured along the longer side"
        raise InvalidInputError(TITLE, [Problem("--resolution", what)])


def cropped(result: Result, crop: Crop) -> Result:
    """Return a part of a result as one of its own, the origin of its sample frame in its middle."""
    rows, columns = slice(crop.y, crop.y + crop.height), slice(crop.x, crop.x + crop.width)
    pixels = np.arange(result.grid.height * result.grid.width).reshape(result.grid.height, -1)[rows, columns]
    return replace(
        result,
        fits=result.fits.select(pixels.ravel()),
        grid=Grid(crop.height, crop.width, result.grid.pitch),
        depth=result.depth[rows, columns],
        depth_sigma=result.depth_sigma[rows, columns],
        truth_error=None if result.truth_error is None else result.truth_error[rows, columns],
        views=None,
    )


def _maps(result: Result, fits: PixelFits, found: PixelSurfaces, solved: NDArray[np.bool_]) -> SurfaceMaps:
    """Put the surfaces of the solved pixels onto the grid."""
    grid = result.grid
    at = solved.reshape(grid.height, grid.width)
    nearest = distance_transform_edt(~at, return_distances=False, return_indices=True)
    flat = nearest[0] * grid.width + nearest[1]
    number = np.cumsum(solved) - 1
    normals = np.where(at[..., None], result.normals, np.array([0.0, 0.0, 1.0]))
    shares = np.zeros((len(solved), 0))
    if found.in_palette.any():
        shares = material_shares(fits, found.in_palette)[number[flat.ravel()]]
    return SurfaceMaps(
        size_mm=(grid.width * grid.pitch, grid.height * grid.pitch),
        surfaces=found.surfaces.select(number[flat.ravel()]),
        normals=normals,
        displacement=_heights(result.depth, at),
        normal_sigma_deg=np.where(at, np.rad2deg(result.as_map(result.fits.normal_sigma)), np.nan),
        material_shares=shares.reshape(grid.height, grid.width, -1),
        solved=at,
    )


def _heights(depth: Array, solved: NDArray[np.bool_]) -> Array:
    """Return the heights about their mean, where unknown the nearest one that is known; 0 without any."""
    known = np.isfinite(depth) & solved
    if not known.any():
        return np.zeros(depth.shape)
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray((depth - depth[known].mean())[tuple(nearest)])


def material_shares(fits: PixelFits, in_palette: NDArray[np.bool_]) -> Array:
    """Return the shares of the palette's materials in each pixel, shape (P, K); 0 in pixels outside it."""
    material = materials_used(fits)
    shares = np.zeros((len(material), int(material.max()) + 2))
    np.add.at(shares, (np.arange(len(material))[:, None], material), fits.coefficient[:, 0])
    total = shares[:, :-1].sum(axis=1, keepdims=True)
    return np.where(in_palette[:, None] & (total > 0.0), shares[:, :-1] / np.where(total > 0.0, total, 1.0), 0.0)


def _averaged(maps: SurfaceMaps, resolution: int) -> SurfaceMaps:
    """Return the maps at so many pixels along the longer side; what was measured inside a pixel is averaged."""
    height, width = maps.shape
    longer = max(height, width)
    size = (max(round(width * resolution / longer), 1), max(round(height * resolution / longer), 1))

    def mean(values: Array) -> Array:
        return resized(values, size)

    def of_surfaces(values: Array) -> Array:
        return mean(values.reshape(height, width, *values.shape[1:])).reshape(-1, *values.shape[1:])

    normals = mean(maps.normals)
    share = mean(maps.solved.astype(np.float64))
    sigma = mean(np.nan_to_num(maps.normal_sigma_deg)) / np.where(share > 0.0, share, 1.0)
    return replace(
        maps,
        surfaces=Surfaces(*(of_surfaces(getattr(maps.surfaces, field.name)) for field in fields(Surfaces))),
        normals=normals / np.linalg.norm(normals, axis=-1, keepdims=True),
        displacement=mean(maps.displacement),
        normal_sigma_deg=np.where(share >= 0.5, sigma, np.nan),
        material_shares=mean(maps.material_shares),
        solved=share >= 0.5,
    )


def resized(values: Array, size: tuple[int, int]) -> Array:
    """Average a map (H, W) or (H, W, K) to `size`, width and height, no larger than it is."""
    if values.size == 0:
        return np.zeros((size[1], size[0], *values.shape[2:]))
    planes = values.reshape(*values.shape[:2], -1)
    # OpenCV takes no more than four channels.
    averaged = [
        cv2.resize(np.ascontiguousarray(planes[..., k]), size, interpolation=cv2.INTER_AREA)
        for k in range(planes.shape[-1])
    ]
    return np.stack(averaged, axis=-1).astype(np.float64).reshape(size[1], size[0], *values.shape[2:])


def _counts(found: PixelSurfaces, solved: NDArray[np.bool_]) -> Counts:
    surfaces = found.surfaces
    return Counts(
        n_pixels=len(solved),
        n_unsolved=int(np.count_nonzero(~solved)),
        n_outside_palette=int(np.count_nonzero(~found.in_palette)),
        n_clipped=int(np.count_nonzero(found.clipped)),
        n_dull=int(np.count_nonzero((surfaces.metallic < 1.0) & (surfaces.f0 >= 0.999 * MAX_DIELECTRIC_F0))),
        n_classes=found.n_classes,
        fit_error_median=float(np.median(found.error)),
        fit_error_p95=float(np.percentile(found.error, 95.0)),
    )
