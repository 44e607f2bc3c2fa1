"""The order of poses that makes short ways: a path through all of them, shortened by turning parts of it round."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MIN_GAIN = 1e-9  # degrees or mm; less is rounding and could go round in circles


def in_short_order(poses: Sequence[dict[str, float]]) -> tuple[dict[str, float], ...]:
    """Return the poses in an order of short ways from position 0 on; the same for the same input.

    Nearest next, then 2-opt [croes1958]: a part of the path is turned round for as long as that shortens it.

    Parameters
    ----------
    poses : sequence of dict
        Positions by axis; all name the same axes, which move at once and equally fast.
    """
    if not poses:
        return ()
    at = np.array([[0.0] * len(poses[0]), *([pose[name] for name in poses[0]] for pose in poses)])
    way = np.abs(at[:, None] - at).max(axis=-1)
    path = _shortened(way, _nearest_next(way))
    return tuple(poses[i - 1] for i in path[1:])


def _nearest_next(way: Array) -> list[int]:
    path, left = [0], set(range(1, len(way)))
    while left:
        path.append(min(sorted(left), key=lambda i: way[path[-1], i]))
        left.remove(path[-1])
    return path


def _shortened(way: Array, path: list[int]) -> list[int]:
    """Turn parts round, the first place kept, until no turn shortens the path."""
    path, improved = list(path), True
    while improved:
        improved = False
        for i, j in combinations(range(1, len(path)), 2):
            if _gain(way, path, i, j) > _MIN_GAIN:
                path[i : j + 1] = path[i : j + 1][::-1]
                improved = True
    return path


def _gain(way: Array, path: list[int], i: int, j: int) -> float:
    """How much shorter the path is with its part i to j turned round; its end is free."""
    before, after = way[path[i - 1], path[i]], way[path[i - 1], path[j]]
    if j + 1 < len(path):
        before, after = before + way[path[j], path[j + 1]], after + way[path[i], path[j + 1]]
    return float(before - after)
