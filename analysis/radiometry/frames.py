"""Merged pictures of a session: counts to radiance, pose by pose."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.conversion import Radiometry, RadiometryFindings
from analysis.radiometry.hdr import Radiance, merge_bracket
from analysis.radiometry.survey import survey
from instrument.files.validation import InvalidInputError, Problem
from instrument.session.session import Session

Array = NDArray[np.float64]


class MergedFrames:
    """Merged pictures of the complete poses of a session, made when asked for.

    Parameters
    ----------
    session : Session

    Attributes
    ----------
    session : Session
    i_pose : ndarray of int
        The complete poses.
    image_size : (int, int)
        Width, height.
    bayer_pattern : str
    radiometry : Radiometry
        Black, clipping, exposure times and noise as the pictures have them.

    Raises
    ------
    InvalidInputError
        If no pose is complete, or the response curve cannot be used.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.i_pose = np.flatnonzero(session.pose_complete)
        if len(self.i_pose) == 0:
            problem = Problem("/entry/journal/pose_complete", "no pose is complete; go on with `halfangle resume`")
            raise InvalidInputError(f"{session.path} cannot be calibrated.", [problem])
        self.bayer_pattern = session.camera.bayer_pattern
        self.image_size = (session.camera.width, session.camera.height)
        self.radiometry: Radiometry = survey(session)

    @property
    def findings(self) -> RadiometryFindings:
        """What the survey of the pictures found, for a report."""
        return self.radiometry.findings

    def merge(self, i_pose: int) -> Radiance:
        """Merge the bracket of one pose, less its ambient light; frames that are not valid are left out."""
        keep = self.session.frame_ok[i_pose]
        times = (self.session.exposure_readback[i_pose] * self.radiometry.time_factors)[keep]
        merged = merge_linear(self.session.frames(i_pose)[keep], times, self.radiometry, keep)
        ambient = self.session.extra.ambient(i_pose)
        if ambient is None:
            return merged
        time = float(self.session.extra.ambient_times[i_pose])
        return less_ambient(merged, self.single(ambient, time))

    def single(self, frame: NDArray[Any], exposure_time: float) -> Radiance:
        """Return one frame as radiance; where darks differ by exposure, the one of the nearest time is subtracted."""
        nearest = np.argmin(np.abs(np.log(self.session.exposure_times / exposure_time)))
        keep = np.arange(len(self.session.exposure_times)) == nearest
        return merge_linear(frame[None], np.array([exposure_time]), self.radiometry, keep)


def merge_linear(
    frames: NDArray[Any], exposure_times: Array, radiometry: Radiometry, keep: NDArray[np.bool_]
) -> Radiance:
    """Merge frames as `radiometry` says.

    Parameters
    ----------
    frames : ndarray, shape (n_kept, height, width) or (n_kept, height, width, 3)
        Counts.
    exposure_times : ndarray, shape (n_kept,)
        Seconds.
    radiometry : Radiometry
    keep : ndarray of bool, shape (n_exposures,)
        Which exposures of the session these are, for their darks.
    """
    return merge_bracket(radiometry.linear(frames), exposure_times, radiometry.dark_of(keep), radiometry.sensor)


def less_ambient(merged: Radiance, ambient: Radiance) -> Radiance:
    """Return a picture without the light that is there when the lamp is off.

    Where the ambient picture is clipped, what it hides is not known: no number.
    """
    mean = np.where(ambient.saturated, np.float32(np.nan), merged.mean - ambient.mean)
    return replace(merged, mean=mean.astype(np.float32), variance=merged.variance + ambient.variance)
