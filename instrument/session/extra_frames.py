"""Reads the pictures of a session beside those of its poses, one at a time."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from instrument.session import layout
from instrument.session.axes import AxesReader


class BesideReader(AxesReader):
    """A session file, as far as pictures for the response, of a flat field and of ambient light go."""

    @cached_property
    def n_poses(self) -> int:
        """P, how many poses the plan has."""
        return int(self._file[layout.IMAGES.path].shape[0])

    @property
    def response_times(self) -> NDArray[np.float64]:
        """Exposure times of the pictures to estimate the response from, shape (R,), seconds; R = 0 if none."""
        return self._array_or_empty(layout.RESPONSE_TIME)

    def response_images(self, i: int) -> NDArray[np.uint16]:
        """Return one picture of a still scene to estimate the response from, shape of a frame, counts."""
        return self._array(layout.RESPONSE_IMAGES, i)

    @property
    def flat_times(self) -> NDArray[np.float64]:
        """Exposure times of the pictures of an even plane, shape (F,), seconds; F = 0 if none."""
        return self._array_or_empty(layout.FLAT_TIME)

    @property
    def flat_distances_mm(self) -> NDArray[np.float64]:
        """Distance of each such plane from the lens, shape (F,), mm; NaN = not stated."""
        return self._array_or_empty(layout.FLAT_DISTANCE)

    def flat_images(self, i: int) -> NDArray[np.uint16]:
        """Return one picture of an even plane, shape of a frame, counts."""
        return self._array(layout.FLAT_IMAGES, i)

    @property
    def ambient_times(self) -> NDArray[np.float64]:
        """Exposure time of each pose's picture without the light, shape (P,), seconds; NaN where there is none."""
        index = self._ambient_of_pose
        if (index < 0).all():
            return np.full(self.n_poses, np.nan)
        times = self._array(layout.AMBIENT_TIME)
        with self._reading(layout.AMBIENT_OF_POSE):
            return np.where(index < 0, np.nan, times[index])

    def ambient(self, i_pose: int) -> NDArray[np.uint16] | None:
        """Return what one pose looks like without the light, shape of a frame, counts; None if there is none."""
        index = int(self._ambient_of_pose[i_pose])
        return None if index < 0 else self._array(layout.AMBIENT_IMAGES, index)

    @cached_property
    def _ambient_of_pose(self) -> NDArray[np.int32]:
        stated = self._stated(layout.AMBIENT_OF_POSE)
        return np.full(self.n_poses, -1, np.int32) if stated is None else stated
