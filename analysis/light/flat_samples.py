"""Blocks of pictures of a blank plane, from which the flat field is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.camera.view import View, rays
from analysis.radiometry.hdr import Radiance
from instrument.files.validation import Problem, raise_if_any

Array = NDArray[np.float64]

N_ACROSS = 48
"""Blocks along the longer side of a picture."""

MAX_CLIPPED = 0.01
"""Share of a picture's pixels that may be clipped."""

NOISIEST = 0.02
"""Relative noise of the typical block, above which a picture is too dark."""

TITLE = "The flat field cannot be found from these pictures."


@dataclass(frozen=True, slots=True)
class PlanePicture:
    """A picture of a blank plane.

    Attributes
    ----------
    name : str
        For messages.
    radiance : Radiance
        Merged; mosaic or with channels.
    view : View
        How the camera saw the plane z = 0.
    """

    name: str
    radiance: Radiance
    view: View


@dataclass(frozen=True, slots=True)
class PlaneSamples:
    """Means of blocks.

    Attributes
    ----------
    log_radiance : ndarray, shape (n_samples,)
    pixel : ndarray, shape (n_samples, 2)
        Centre of the block.
    in_camera : ndarray, shape (n_samples, 3)
        Where it lies on the plane, camera frame, mm.
    normal : ndarray, shape (n_samples, 3)
        Of the plane, towards the camera, camera frame.
    picture : ndarray of int, shape (n_samples,)
        Index of its picture.
    share_clipped : ndarray, shape (n_pictures,)
    """

    log_radiance: Array
    pixel: Array
    in_camera: Array
    normal: Array
    picture: NDArray[np.int64]
    share_clipped: Array


def plane_samples(pictures: Sequence[PlanePicture]) -> PlaneSamples:
    """Average blocks of each picture.

    Parameters
    ----------
    pictures : sequence of PlanePicture
        All of one size.

    Raises
    ------
    InvalidInputError
        With every picture that is too dark, clipped or of another size, and by how much.
    """
    if not pictures:
        raise_if_any(TITLE, [Problem("flats", "there is none; take a matte white or grey card that fills the picture")])
    size = pictures[0].radiance.mean.shape
    raise_if_any(TITLE, [p for picture in pictures for p in _problems(picture, size)])
    parts = [_blocks(picture, i) for i, picture in enumerate(pictures)]
    log_radiance, pixel, in_camera, normal, index = (np.concatenate(part) for part in zip(*parts, strict=True))
    share = np.array([picture.radiance.saturated.mean() for picture in pictures])
    return PlaneSamples(log_radiance, pixel, in_camera, normal, index, share)


def _problems(picture: PlanePicture, size: tuple[int, ...]) -> list[Problem]:
    radiance = picture.radiance
    if radiance.mean.shape != size:
        what = f"has the shape {radiance.mean.shape}, others {size}; all flats must be of the camera's full picture"
        return [Problem(picture.name, what)]
    problems = []
    clipped = float(radiance.saturated.mean())
    if clipped > MAX_CLIPPED:
        what = f"is clipped in {clipped:.1%} of its pixels, allowed is {MAX_CLIPPED:.0%}; expose shorter"
        problems.append(Problem(picture.name, what))
    noise = _noise(radiance)
    if not noise < NOISIEST:
        what = f"is too dark: its blocks have {noise:.1%} noise, allowed is {NOISIEST:.0%}; expose longer"
        problems.append(Problem(picture.name, what))
    return problems


def _noise(radiance: Radiance) -> float:
    """Return the relative noise of the typical block."""
    block = _block_size(radiance.mean)
    mean, n = float(np.median(radiance.mean)), block * block * np.prod(radiance.mean.shape[2:])
    return float(np.sqrt(np.median(radiance.variance) / n) / mean) if mean > 0.0 else np.inf


def _block_size(picture: NDArray[np.float32]) -> int:
    """Return the side of a block: even, so that each holds all places of the colour cell alike."""
    return max(int(max(picture.shape[:2])) // N_ACROSS // 2 * 2, 2)


def _blocks(picture: PlanePicture, index: int) -> tuple[Array, Array, Array, Array, NDArray[np.int64]]:
    """Return log radiance, pixel, point, normal and index of the blocks of a picture that are not clipped."""
    radiance, size = picture.radiance, _block_size(picture.radiance.mean)
    mean = _block_means(radiance.mean, size)
    good = (_block_means(radiance.saturated.astype(np.float32), size) == 0.0) & (mean > 0.0)
    row, column = np.nonzero(good)
    pixel = np.stack([column, row], axis=-1).astype(np.float64) * size + (size - 1) / 2.0
    in_camera, normal = _on_plane(picture.view, pixel)
    log_radiance = np.log(mean[good].astype(np.float64))
    normals, of = np.tile(normal, (len(pixel), 1)), np.full(len(pixel), index, np.int64)
    return log_radiance, pixel, in_camera, normals, of


def _block_means(picture: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    rows, columns = picture.shape[0] // size, picture.shape[1] // size
    tiles = picture[: rows * size, : columns * size].reshape(rows, size, columns, size, -1)
    return np.asarray(tiles.mean(axis=(1, 3, 4)), np.float32)


def _on_plane(view: View, pixel: Array) -> tuple[Array, Array]:
    """Return where the rays of pixels meet the plane z = 0 of the sample frame, and its normal, in the camera frame."""
    ray = rays(view.camera_matrix, view.distortion, pixel)
    normal = view.rotation[:, 2]
    depth = (normal @ np.ravel(view.translation)) / (ray @ normal)
    return ray * depth[:, None], np.asarray(normal, np.float64)
