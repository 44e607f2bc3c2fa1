"""Chooses the poses that together tell most: one after the other, then by exchange [fedorov1972]."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from drivers.stage import AxisDescription
from instrument.config.protocol import ChosenConfig
from instrument.config.rig import RigConfig
from instrument.files.validation import InvalidInputError, Problem
from protocols.poses.criterion import Array, Criterion, Pose
from protocols.poses.nominal_geometry import lens_and_light
from protocols.poses.order import in_short_order

STEP_DEG = 5.0
"""Between the positions of a rotation axis that are candidates."""

SAME_DEG = 0.1
"""Closer together, two sides from which the sample is seen are one."""

_MAX_PASSES = 20

_MIN_GAIN = 1e-9  # of the criterion, relative; less is rounding and could go round in circles

_SLACK_DEG = 1e-6  # for rounding, where a tilt is just the largest


def choose_poses(
    rig: RigConfig, axes: Sequence[AxisDescription], choice: ChosenConfig, already: Sequence[Pose] = ()
) -> tuple[dict[str, float], ...]:
    """Return the poses that lower the expected error of normals and BRDF most, in an order of short ways.

    Parameters
    ----------
    rig : RigConfig
        Says where lens and light stand, and the area.
    axes : sequence of AxisDescription
        The stage's, from the base to the sample. The two rotations next to the sample are used; what else there is
        stays where it is next to 0.
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
    possible = candidates(rig, axes, choice, already)
    if len(possible) < choice.count:
        raise InvalidInputError("the poses cannot be chosen", [_too_few(len(possible), choice)])
    criterion = Criterion.of(rig, axes, choice, possible, already)
    chosen = _exchanged(criterion, _greedy(criterion, choice.count))
    return in_short_order([possible[i] for i in chosen])


def _greedy(criterion: Criterion, count: int) -> list[int]:
    """Choose one view after the other, each the best beside those before."""
    chosen: list[int] = []
    for _ in range(count):
        chosen.append(_best(criterion, chosen)[0])
    return chosen


def _exchanged(criterion: Criterion, chosen: list[int]) -> list[int]:
    """Exchange each view for the best one beside the others, until a whole pass gains nothing."""
    best = criterion.value(chosen)
    for _ in range(_MAX_PASSES):
        before = best
        for k in range(len(chosen)):
            others = chosen[:k] + chosen[k + 1 :]
            view, value = _best(criterion, others)
            if value < best * (1.0 - _MIN_GAIN):
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


def candidates(
    rig: RigConfig, axes: Sequence[AxisDescription], choice: ChosenConfig, already: Sequence[Pose]
) -> list[dict[str, float]]:
    """Return poses on a grid within the limits that see the sample from different sides, none of `already`.

    Parameters
    ----------
    rig, axes, choice, already
        As for `choose_poses`.
    """
    used = [axis.name for axis in axes if axis.kind == "rotation"][-2:]
    positions = {axis.name: _positions(axis) if axis.name in used else [_rest(axis)] for axis in axes}
    poses = [dict(zip(positions, at, strict=True)) for at in product(*positions.values())]
    taken, sides = (_sides(lens_and_light(rig, axes, some)[0]) for some in (already, poses))
    is_new = (sides @ taken.T <= np.cos(np.deg2rad(SAME_DEG))).all(axis=1)
    return [poses[i] for i in _different(sides, choice.largest_tilt_deg) if is_new[i]]


def _sides(lens: Array) -> Array:
    """Return the unit vectors towards places of the lens, shape (P, 3)."""
    return np.asarray(lens / np.linalg.norm(lens, axis=1, keepdims=True))


def _different(sides: Array, largest_tilt_deg: float) -> list[int]:
    """Return which directions to keep: those within the tilt, each other than all that were kept before it.

    What comes first is kept: the smallest positions, and positive ones before negative ones.
    """
    kept: list[int] = []
    for i in np.flatnonzero(sides[:, 2] >= np.cos(np.deg2rad(largest_tilt_deg + _SLACK_DEG))):
        if not (sides[kept] @ sides[i] > np.cos(np.deg2rad(SAME_DEG))).any():
            kept.append(int(i))
    return kept


def _positions(axis: AxisDescription) -> list[float]:
    """Return the grid of a rotation, from 0 outwards and once round at most."""
    low, high = axis.soft_limits.low, axis.soft_limits.high
    steps = np.arange(np.ceil(low / STEP_DEG), np.floor(high / STEP_DEG) + 1.0)
    positions = sorted((STEP_DEG * steps + 0.0).tolist(), key=lambda position: (abs(position), -position))
    return positions[: round(360.0 / STEP_DEG)]


def _rest(axis: AxisDescription) -> float:
    return min(max(0.0, axis.soft_limits.low), axis.soft_limits.high)


def _too_few(n_candidates: int, choice: ChosenConfig) -> Problem:
    return Problem(
        "chosen.count",
        f"is {choice.count}, but within the stage's limits and {choice.largest_tilt_deg:g} deg there are "
        f"{n_candidates} poses to choose from. Ask for fewer or allow larger tilts.",
    )
