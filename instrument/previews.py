"""The previews that a session holds."""

from __future__ import annotations

import numpy as np

from instrument.preview import Preview, best_exposure
from instrument.session import Session


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
