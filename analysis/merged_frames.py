"""Merged pictures of a session: counts to radiance, pose by pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.hdr import Radiance, Sensor, merge_bracket
from analysis.saturation import find_saturation
from instrument.session import Session
from instrument.validation import InvalidInputError, Problem


class MergedFrames:
    """Merged pictures of the complete poses of a session, made when asked for.

    Parameters
    ----------
    session : Session

    Raises
    ------
    InvalidInputError
        If no pose is complete.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.i_pose = np.flatnonzero(session.pose_complete)
        if len(self.i_pose) == 0:
            problem = Problem("/entry/journal/pose_complete", "no pose is complete; go on with `halfangle resume`")
            raise InvalidInputError(f"{session.path} cannot be calibrated.", [problem])
        camera = session.camera
        nominal = Sensor(camera.saturation_value, camera.conversion_gain, camera.read_noise)
        frames = session.frames(int(self.i_pose[0]))
        saturation = find_saturation(frames, camera.saturation_value, camera.black_level, nominal)
        self.sensor = replace(nominal, saturation_level=saturation.level)
        self.bayer_pattern = camera.bayer_pattern
        self.image_size = (camera.width, camera.height)
        dark = session.dark
        shape = (len(session.exposure_times), camera.height, camera.width)
        self._dark = np.full(shape, camera.black_level, np.float32) if dark is None else dark

    def merge(self, i_pose: int) -> Radiance:
        """Merge the bracket of one pose; frames that are not valid are left out."""
        keep = self.session.frame_ok[i_pose]
        times = self.session.exposure_readback[i_pose]
        return merge_bracket(self.session.frames(i_pose)[keep], times[keep], self._dark[keep], self.sensor)
