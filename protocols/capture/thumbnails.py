"""Thumbnails of a bracket and a preview of the pose, for those who watch a capture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription
from instrument.session.preview import Preview, best_exposure, preview
from instrument.session.records import PoseRecord
from protocols.acquisition.frame_checks import clipped_shares
from protocols.capture.progress import PoseTaken

MAX_WIDTH = 160
"""Pixels across a thumbnail at most."""


def pose_taken(i_pose: int, record: PoseRecord, camera: CameraDescription) -> PoseTaken:
    """Return what is shown of a pose; about 6 ms for five frames of 2.3 Mpixel."""
    times, black, saturation = record.exposure_readback, camera.black_level, camera.saturation_level
    clipped = clipped_shares(record.counts, camera)
    ceiling = (saturation - black) / float(times[best_exposure(clipped)])
    return PoseTaken(
        i_pose=i_pose,
        thumbnails=thumbnails(record.counts, black, saturation),
        exposure_times=times,
        clipped=clipped,
        preview=Preview(preview(record.counts, times, black, clipped), ceiling),
    )


def thumbnails(counts: NDArray[np.uint16] | NDArray[np.float32], black: float, saturation: float) -> NDArray[np.uint8]:
    """Return frames at most `MAX_WIDTH` pixels across, from the black to the saturation level; shape (K, h, w).

    Of each block the first cell of a Bayer mosaic is taken: quick, and good enough to recognise a picture.

    Parameters
    ----------
    counts : ndarray of uint16 or float32, shape (K, H, W)
        Raw frames.
    black, saturation : float
        Counts.
    """
    step = 2 * max(1, -(-counts.shape[2] // (2 * MAX_WIDTH)))
    corners = [counts[:, i::step, j::step] for i in (0, 1) for j in (0, 1)]
    h, w = (min(corner.shape[axis] for corner in corners) for axis in (1, 2))
    cells = sum(corner[:, :h, :w].astype(np.float32) for corner in corners) / 4.0
    shown = 255.0 * (cells - black) / (saturation - black)
    return np.asarray(np.clip(shown, 0.0, 255.0), np.uint8)
