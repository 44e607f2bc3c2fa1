"""Previews of a capture on the sample plane, placed by the nominal poses."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.registration.grid import Grid
from analysis.registration.stack import Stack
from instrument.session.nominal_views import NominalViews
from instrument.session.preview import Preview, block_of

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]

N_CELLS = 64
"""Cells along the longer side of the area."""

CLIPS_FROM = 0.7
"""Of the ceiling: a cell so bright holds clipped pixels, of one colour at least."""

_BLUR = 0.4  # standard deviation in cells, against aliasing


def quick_grid(area_mm: tuple[float, float]) -> Grid:
    """Return cells over an area, width and height in mm."""
    return Grid.covering(area_mm, max(area_mm) / N_CELLS)


def quick_stack(views: NominalViews, previews: Mapping[int, Preview]) -> Stack:
    """Return the views of some poses on the cells of the area; NaN outside a picture.

    By OpenCV, and not by the calibrated chain's kernels: those share one pool of threads, which work of another thread
    of the program may be using.

    Parameters
    ----------
    views : NominalViews
        Of all poses.
    previews : mapping of int to Preview
        By pose; none = a stack of no views.
    """
    grid, poses = quick_grid(views.area_mm), np.array(sorted(previews), int)
    shape = (len(poses), grid.height, grid.width, 1)
    radiance, saturated = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
    for i, i_pose in enumerate(poses):
        radiance[i, ..., 0], saturated[i, ..., 0] = _on_grid(views, int(i_pose), previews[int(i_pose)], grid)
    return Stack(
        radiance=radiance,
        camera_position=views.lens[poses],
        light_position=views.light[poses],
        pixel_pitch=grid.pitch,
        light_power=np.ones(len(poses)),
        saturated=saturated,
    )


def _on_grid(views: NominalViews, i_pose: int, preview: Preview, grid: Grid) -> tuple[Array32, NDArray[np.uint8]]:
    """Return radiance and whether it is clipped, each of shape (H, W)."""
    block = block_of(views.height, views.width)
    H = homography(views, i_pose, block, grid)
    cell_px = grid.pitch * views.focal_length_px / block / float(np.linalg.norm(views.lens[i_pose]))
    picture = np.ascontiguousarray(preview.picture, np.float32)
    clipped = (picture >= CLIPS_FROM * preview.ceiling).astype(np.float32)
    radiance = _warped(_blurred(picture, cell_px), H, grid)
    return radiance, np.asarray(np.nan_to_num(_warped(clipped, H, grid)) > 0.0, np.uint8)


def homography(views: NominalViews, i_pose: int, block: int, grid: Grid) -> Array:
    """Return the matrix from (column, row, 1) of a cell to those of a preview, shape (3, 3)."""
    R, half = views.rotation[i_pose], 0.5 * np.array([grid.width - 1, grid.height - 1])
    t = -R @ views.lens[i_pose]
    plane_from_cell = np.array(
        [[grid.pitch, 0.0, -half[0] * grid.pitch], [0.0, -grid.pitch, half[1] * grid.pitch], [0.0, 0.0, 1.0]]
    )
    return np.asarray(views.camera_matrix(block) @ np.column_stack([R[:, 0], R[:, 1], t]) @ plane_from_cell)


def _blurred(picture: Array32, cell_px: float) -> Array32:
    """Return a picture without what cells of so many of its pixels cannot show."""
    if cell_px <= 1.0:
        return picture
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), _BLUR * cell_px), np.float32)


def _warped(picture: Array32, H: Array, grid: Grid) -> Array32:
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (grid.width, grid.height)
    outside = float("nan")
    return np.asarray(cv2.warpPerspective(picture, H, size, flags=how, borderValue=outside), np.float32)
