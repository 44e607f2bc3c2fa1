"""Small pictures and numbers of a bracket, for the overview and the quality plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instrument.session.session import Session

# Pixels across a preview at most; enough to recognise a pose, small enough to draw all of them.
MAX_WIDTH = 320

# Share of clipped pixels up to which an exposure still shows the whole sample.
CLIPPED_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Preview:
    """A small picture of one pose, and what it cannot exceed.

    Attributes
    ----------
    picture : ndarray of float32, shape (h, w)
        Counts per second, as `preview` returns them.
    ceiling : float
        Counts per second of a cell all of whose pixels are clipped.
    """

    picture: NDArray[np.float32]
    ceiling: float


def preview_shape(height: int, width: int) -> tuple[int, int]:
    """Return the height and width of the preview of a frame."""
    block = block_of(height, width)
    return height // block, width // block


def preview(
    counts: NDArray[np.uint16] | NDArray[np.float32],
    exposure_times: NDArray[np.float64],
    black_level: float,
    saturated_fraction: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return block means of the longest exposure that is not clipped; of the shortest if all are.

    Parameters
    ----------
    counts : ndarray of uint16 or float32, shape (E, H, W) or (E, H, W, 3)
        One bracket.
    exposure_times : ndarray, shape (E,)
        Seconds, ascending.
    black_level : float
        Counts of darkness.
    saturated_fraction : ndarray, shape (E,)
        Share of clipped pixels of each frame.

    Returns
    -------
    ndarray of float32, shape (h, w)
        Counts per second; a cell of a Bayer mosaic is averaged as a whole, and so are the channels of a pixel.
    """
    best = best_exposure(saturated_fraction)
    height, width = counts.shape[1:3]
    block = block_of(height, width)
    h, w = preview_shape(height, width)
    cells = counts[best, : h * block, : w * block]
    # Whole rows first: that adds long runs of numbers, three times as fast as block by block.
    rows = cells.reshape(h, block, -1).sum(axis=1, dtype=np.uint32 if cells.dtype == np.uint16 else np.float64)
    means = rows.reshape(h, w, -1).sum(axis=2, dtype=np.float64) * (h * w / cells.size)
    return np.asarray((means - black_level) / exposure_times[best], dtype=np.float32)


def best_exposure(saturated_fraction: NDArray[np.float64]) -> int:
    """Return which exposure a preview is made of: the longest that is not clipped, the first if all are."""
    usable = np.flatnonzero(saturated_fraction <= CLIPPED_SHARE)
    return int(usable[-1]) if usable.size else 0


def fraction(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the share of pixels set in each frame; mask (E, H, W) or (E, H, W, 3) to shape (E,)."""
    return np.array([np.count_nonzero(frame) / frame.size for frame in mask])


def block_of(height: int, width: int) -> int:
    """Return the side of a block in pixels of a frame, even so that it holds whole cells of a Bayer mosaic."""
    wanted = 2 * max(1, -(-width // (2 * MAX_WIDTH)))
    # A very flat picture keeps four rows: viewers take an axis of one or two for colours.
    return min(wanted, max(2, height // 8 * 2))


def previews_of(session: Session) -> dict[int, Preview]:
    """Return the previews of a session's complete poses, by pose.

    Raises
    ------
    InvalidInputError
        If one cannot be read.
    """
    clipped, times = session.saturated_fraction, session.exposure_readback
    span = session.camera.saturation_value - session.camera.black_level
    previews = {}
    for i_pose in np.flatnonzero(session.pose_complete).tolist():
        # A spare exposure was taken at some poses only.
        taken = np.flatnonzero(np.isfinite(clipped[i_pose]))
        time = times[i_pose, taken[best_exposure(clipped[i_pose, taken])]]
        previews[i_pose] = Preview(session.preview(i_pose), float(span / time))
    return previews
