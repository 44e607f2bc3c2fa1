"""What a set of poses is worth: the error that is to be expected of normals and BRDF [fedorov1972]."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.stage import AxisDescription
from instrument.config.protocol import ChosenConfig
from instrument.config.rig import RigConfig
from protocols.poses.information import expected_cases, information_vectors, prior_information
from protocols.poses.nominal_geometry import lens_and_light
from protocols.poses.rough_material import dot

Array = NDArray[np.float64]

Pose = Mapping[str, float]


@dataclass(frozen=True)
class Criterion:
    """Expected error of a set of views: the geometric mean over the cases of sqrt(tr(A C)), degrees; A-optimal.

    By the geometric mean a pixel that is hard to measure, or that no view tells of, counts no more than another.

    Attributes
    ----------
    u : ndarray, shape (K, V, 5)
        Of all views, as of `information_vectors`.
    known : ndarray, shape (K, 5, 5)
        Information before any of the views.
    loss : ndarray, shape (K, 5, 5)
        A.
    """

    u: Array
    known: Array
    loss: Array

    @classmethod
    def of(
        cls,
        rig: RigConfig,
        axes: Sequence[AxisDescription],
        choice: ChosenConfig,
        poses: Sequence[Pose],
        already: Sequence[Pose] = (),
    ) -> Criterion:
        """Return the criterion of sets of `poses`, those `already` taken being known."""
        cases = expected_cases(rig, choice)
        u, taken = (
            information_vectors(cases, *lens_and_light(rig, axes, some), rig.geometry.working_distance_mm)
            for some in (poses, already)
        )
        return cls(u, prior_information() + np.swapaxes(taken, 1, 2) @ taken, cases.loss)

    def value(self, views: Sequence[int]) -> float:
        """Return the expected error of a set of views, degrees."""
        return float(_typical(_trace(self.loss @ self._covariance(views))))

    def with_one_more(self, views: Sequence[int]) -> Array:
        """Return the expected error, degrees, of the set with each of the V views added, shape (V,).

        By (M + u u^T)^-1 = C - C u u^T C / (1 + u^T C u) [sherman1950].
        """
        C = self._covariance(views)
        Cu = self.u @ C
        gain = dot(Cu @ self.loss, Cu) / (1.0 + dot(self.u, Cu))
        return _typical(_trace(self.loss @ C)[:, None] - gain)

    def _covariance(self, views: Sequence[int]) -> Array:
        """C of a set of views, shape (K, 5, 5)."""
        u = self.u[:, list(views)]
        return np.asarray(np.linalg.inv(self.known + np.swapaxes(u, 1, 2) @ u))


def _typical(loss: Array) -> Array:
    """Return the geometric mean over the first axis of the roots."""
    return np.asarray(np.exp(0.5 * np.log(loss).mean(axis=0)))


def _trace(matrices: Array) -> Array:
    return np.asarray(np.trace(matrices, axis1=-2, axis2=-1))
