"""Groups pictures into brackets: which of them make a pose, and which exposure each of them is."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

# Cameras state 1/60 s once as 0.0167 and once as 0.01665; their finest steps are a sixth of a stop, 12 %.
SAME_TIME = 1.03

_SAME_STEP = 2.0 * np.log(SAME_TIME)  # both of its ends are stated to a few percent


def split_by_exposure(times: Sequence[float]) -> list[int]:
    """Return how many pictures each pose has, when a series of brackets is told apart by its exposure times.

    A new pose begins where a time comes again. If the poses then have different times, the base exposure may differ
    from pose to pose: where brackets of one length all go through the same steps, in whichever order a camera takes
    them (0, -2, +2 EV), that is how they are split. Else a new pose begins also where a bracket that has run up or
    down turns back.

    Parameters
    ----------
    times : sequence of float
        Seconds, in the order in which the pictures were taken.
    """
    by_repeat = _split(times, turning=False)
    brackets = [sorted(bracket) for bracket in by_repeat]
    alike = all(
        len(a) == len(b) and all(same_time(x, y) for x, y in zip(a, b, strict=True)) for a, b in pairwise(brackets)
    )
    if alike and len(brackets) > 1:
        return [len(bracket) for bracket in by_repeat]
    length = _common_length(times)
    if length:
        return [length] * (len(times) // length)
    return [len(bracket) for bracket in _split(times, turning=True)]


def _common_length(times: Sequence[float]) -> int:
    """Return the length of brackets that all go through the same steps, from 3 up; 0 if there is none.

    A series that only rises or falls is one bracket: every step of it may be the same.
    """
    steps = np.diff(np.log(np.asarray(times, np.float64)))
    if np.all(steps > 0.0) or np.all(steps < 0.0):
        return 0
    for length in range(3, len(times) // 2 + 1):
        if len(times) % length:
            continue
        relative = np.log(np.reshape(times, (-1, length)))
        relative -= relative[:, :1]
        apart = np.diff(np.sort(relative[0])) > np.log(SAME_TIME)
        if apart.all() and np.all(np.ptp(relative, axis=0) < _SAME_STEP):
            return length
    return 0


def _split(times: Sequence[float], turning: bool) -> list[list[float]]:
    brackets: list[list[float]] = []
    for time in times:
        if not brackets or _begins_anew(brackets[-1], time, turning):
            brackets.append([])
        brackets[-1].append(time)
    return brackets


def _begins_anew(bracket: Sequence[float], time: float, turning: bool) -> bool:
    if any(same_time(time, other) for other in bracket):
        return True
    return turning and len(bracket) > 1 and (time > bracket[-1]) != (bracket[1] > bracket[0])


def same_time(first: float, second: float) -> bool:
    """Whether two exposure times are one setting of a camera."""
    return max(first, second) <= SAME_TIME * min(first, second)


def nominal_times(brackets: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """Return the exposure times of a session, ascending: all that any pose has, like ones as one.

    Times of one setting that differ a little are rounded to three digits, others to six; if a pose has two such
    times, they are meant, and every time stands for itself.
    """
    every = sorted({time for bracket in brackets for time in bracket})
    clusters: list[list[float]] = []
    for time in every:
        if not clusters or not same_time(clusters[-1][0], time):
            clusters.append([])
        clusters[-1].append(time)
    rounded = tuple(_rounded(cluster) for cluster in clusters)
    for bracket in brackets:
        if len(set(exposure_indices(bracket, rounded))) < len(set(bracket)):
            return tuple(every)
    return rounded


def exposure_indices(bracket: Sequence[float], exposure_times: Sequence[float]) -> list[int]:
    """Return which of the session's exposures each time of a bracket is: the nearest one on a logarithmic scale."""
    log_times = np.log(exposure_times)
    return [int(np.argmin(np.abs(log_times - np.log(time)))) for time in bracket]


def _rounded(cluster: Sequence[float]) -> float:
    # Six digits are more than a shutter keeps, and leave none of the last bit that arithmetic adds.
    return float(f"{cluster[0]:.6g}" if len(cluster) == 1 else f"{np.mean(cluster):.3g}")
