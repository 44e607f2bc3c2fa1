"""Chooses the poses that together tell most: one after the other, then by exchange [fedorov1972]."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from drivers.stage import AxisDescription
from instrument.chosen_config import ChosenConfig
from instrument.rig_config import RigConfig
from instrument.validation import InvalidInputError, Problem
from protocols.information import expected_cases, information_vectors, prior_information
from protocols.nominal_geometry import lens_and_light
from protocols.pose_order import in_short_order
from protocols.rough_material import dot

Array = NDArray[np.float64]
Pose = Mapping[str, float]

STEP_DEG = 5.0
"""Between the positions of a rotation axis that are candidates."""
_MOST_PASSES = 20
_LEAST_GAIN = 1e-9  # of the criterion, relative; less is rounding and could go round in circles
_SAME_MM = 1e-6  # closer together, two places of the lens are one


def choose_poses(
    rig: RigConfig, axes: Sequence[AxisDescription], choice: ChosenConfig, already: Sequence[Pose] = ()
) -> tuple[dict[str, float], ...]:
    """Return the poses that lower the expected error of normals and BRDF most, in an order of short ways.

    Parameters
    ----------
    rig : RigConfig
        Says where lens and light stand, and the area.
    axes : sequence of AxisDescription
        The stage's, from the base to the sample. Those that travel stay where they are next to 0.
    choice : ChosenConfig
    already : sequence of mapping
        Poses that were taken: what they tell is known, and none of them is chosen again.

    Returns
    -------
    tuple of dict
        `choice.count` positions by axis; the same for the same input.

    Raises
    ------
    InvalidInputError
        If so many poses are not within the limits.
    """
    candidates = _candidates(rig, axes, choice, already)
    if len(candidates) < choice.count:
        raise InvalidInputError("the poses cannot be chosen", [_too_few(len(candidates), choice)])
    criterion = Criterion.of(rig, axes, choice, candidates, already)
    chosen = _exchanged(criterion, _greedy(criterion, choice.count))
    return in_short_order([candidates[i] for i in chosen])


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


def _greedy(criterion: Criterion, count: int) -> list[int]:
    """Choose one view after the other, each the best beside those before."""
    chosen: list[int] = []
    for _ in range(count):
        chosen.append(_best(criterion, chosen)[0])
    return chosen


def _exchanged(criterion: Criterion, chosen: list[int]) -> list[int]:
    """Exchange each view for the best one beside the others, until a whole pass gains nothing."""
    best = criterion.value(chosen)
    for _ in range(_MOST_PASSES):
        before = best
        for k in range(len(chosen)):
            others = chosen[:k] + chosen[k + 1 :]
            view, value = _best(criterion, others)
            if value < best * (1.0 - _LEAST_GAIN):
                chosen, best = [*others[:k], view, *others[k:]], value
        if best == before:
            break
    return chosen


def _best(criterion: Criterion, others: list[int]) -> tuple[int, float]:
    """Return the view that lowers the expected error most beside others, and that error."""
    value = criterion.with_one_more(others)
    value[others] = np.inf
    i = int(np.argmin(value))
    return i, float(value[i])


def _candidates(
    rig: RigConfig, axes: Sequence[AxisDescription], choice: ChosenConfig, already: Sequence[Pose]
) -> list[dict[str, float]]:
    """Return poses on a grid within the limits, one for each place of the lens about the sample, none of `already`."""
    names = [axis.name for axis in axes]
    poses = [dict(zip(names, at, strict=True)) for at in product(*(_positions(axis) for axis in axes))]
    lens, _ = lens_and_light(rig, axes, [*already, *poses])
    allowed = lens[:, 2] >= np.cos(np.deg2rad(choice.largest_tilt_deg)) * np.linalg.norm(lens, axis=1) - _SAME_MM
    # The first of equal places is kept: that with the smallest positions, positive ones before negative ones.
    _, first = np.unique(np.round(lens / _SAME_MM), axis=0, return_index=True)
    return [poses[i - len(already)] for i in sorted(first) if i >= len(already) and allowed[i]]


def _positions(axis: AxisDescription) -> list[float]:
    """Return the grid of an axis, from 0 outwards and once round; one that travels has the position next to 0 only."""
    low, high = axis.soft_limits.low, axis.soft_limits.high
    if axis.kind == "translation":
        return [min(max(0.0, low), high)]
    steps = np.arange(np.ceil(low / STEP_DEG), np.floor(high / STEP_DEG) + 1.0)
    positions = sorted((STEP_DEG * steps + 0.0).tolist(), key=lambda position: (abs(position), -position))
    return positions[: round(360.0 / STEP_DEG)]


def _too_few(n_candidates: int, choice: ChosenConfig) -> Problem:
    return Problem(
        "chosen.count",
        f"is {choice.count}, but within the stage's limits and {choice.largest_tilt_deg:g} deg there are "
        f"{n_candidates} poses to choose from. Ask for fewer or allow larger tilts.",
    )
