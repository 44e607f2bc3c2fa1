"""Reads the pictures of a session that show no pose, one at a time."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from instrument.session import layout
from instrument.session.reader import SessionReader


class ExtraFrames:
    """Pictures for the response, of a flat field and of ambient light.

    Parameters
    ----------
    reader : SessionReader
    n_poses : int
        P, how many poses the plan has.
    """

    def __init__(self, reader: SessionReader, n_poses: int) -> None:
        self._reader, self._n_poses = reader, n_poses

    @property
    def response_times(self) -> NDArray[np.float64]:
        """Exposure times of the pictures to estimate the response from, shape (R,), seconds; R = 0 if none."""
        return self._reader.array_or_empty(layout.RESPONSE_TIME)

    def response_images(self, i: int) -> NDArray[np.uint16]:
        """Return one picture of a still scene to estimate the response from, shape of a frame, counts."""
        return self._reader.array(layout.RESPONSE_IMAGES, i)

    @property
    def flat_times(self) -> NDArray[np.float64]:
        """Exposure times of the pictures of an even plane, shape (F,), seconds; F = 0 if none."""
        return self._reader.array_or_empty(layout.FLAT_TIME)

    @property
    def flat_distances_mm(self) -> NDArray[np.float64]:
        """Distance of each such plane from the lens, shape (F,), mm; NaN = not given."""
        return self._reader.array_or_empty(layout.FLAT_DISTANCE)

    def flat_images(self, i: int) -> NDArray[np.uint16]:
        """Return one picture of an even plane, shape of a frame, counts."""
        return self._reader.array(layout.FLAT_IMAGES, i)

    @property
    def ambient_times(self) -> NDArray[np.float64]:
        """Exposure time of each pose's picture without the light, shape (P,), seconds; NaN where there is none."""
        index = self._ambient_of_pose
        if (index < 0).all():
            return np.full(self._n_poses, np.nan)
        times = self._reader.array(layout.AMBIENT_TIME)
        with self._reader.reading(layout.AMBIENT_OF_POSE):
            return np.where(index < 0, np.nan, times[index])

    def ambient(self, i_pose: int) -> NDArray[np.uint16] | None:
        """Return what one pose looks like without the light, shape of a frame, counts; None if there is none."""
        index = int(self._ambient_of_pose[i_pose])
        return None if index < 0 else self._reader.array(layout.AMBIENT_IMAGES, index)

    @cached_property
    def _ambient_of_pose(self) -> NDArray[np.int32]:
        given = self._reader.optional(layout.AMBIENT_OF_POSE)
        return np.full(self._n_poses, -1, np.int32) if given is None else given
