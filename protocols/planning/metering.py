"""Chooses the bracket: the fewest exposures that keep the noise of the merged radiance within a bound.

At radiance L (electrons per second) an exposure of t seconds collects e = L t electrons with variance e + r^2; its
relative information is w = e^2 / (e + r^2). Exposures that do not clip there add up: the relative noise of the merged
value is 1 / sqrt(sum w). From the shortest exposure upwards, each next one is the longest for which the shorter ones
still keep the bound where it begins to clip. No set of fewer exposures covers the same range: by induction, the k-th
exposure of any set that keeps the bound is no longer than the k-th of this one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription
from drivers.errors import UnsafeError
from instrument.config.protocol import AutoConfig
from instrument.rig.rig import Rig
from protocols.acquisition.shot import lease_seconds, light_on, move_verified, take_shot
from protocols.planning.plan import Plan

# Poses at which scout frames are taken at most: highlights come and go with the pose.
N_SCOUTS = 8

# From one scout exposure to the next; each pixel is read from the longest that does not clip it.
_SCOUT_RATIO = 8.0

# Of the range above black that an exposure may fill: the power differs from pose to pose, and so does a highlight.
_FILL = 0.8

# Products of times and radiances are as exact as this; what just fits must fit.
_ROUNDING = 1e-6

# Share of the pixels that may be brighter than the bracket is made for.
_GLINTS = 1e-4


@dataclass(frozen=True, slots=True)
class SceneRange:
    """Electrons per second and pixel of what the scouts saw, from the darkest to the brightest part to capture."""

    darkest: float
    brightest: float


@dataclass(frozen=True, slots=True)
class Metered:
    """A chosen bracket.

    Attributes
    ----------
    exposure_times : tuple of float
        Seconds, ascending.
    scene : SceneRange
    noise : float
        Largest relative noise over that range.
    """

    exposure_times: tuple[float, ...]
    scene: SceneRange
    noise: float


def meter(rig: Rig, plan: Plan, auto: AutoConfig) -> Metered:
    """Take scout frames at some poses of a plan and choose its bracket.

    Raises
    ------
    DeviceError
        If a device fails.
    UnsafeError
        If the bound cannot be kept; says by how much and what would help.
    """
    camera = rig.camera.describe()
    limits = camera.exposure_time_limits
    shortest, longest = max(auto.shortest_s, limits.low), min(auto.longest_s, limits.high)
    scenes = [_scout(rig, plan.target(i), shortest, longest, auto) for i in scout_poses(plan.n_poses)]
    scene = SceneRange(min(s.darkest for s in scenes), max(s.brightest for s in scenes))
    well = _FILL * (camera.saturation_level - camera.black_level) * camera.conversion_gain
    # A hundredth is kept for rounding the times.
    times = fewest_exposures(scene, 0.99 * auto.noise, well, camera.read_noise, (shortest, longest))
    times = tuple(dict.fromkeys(_rounded(time) for time in times))
    noise = largest_noise(times, scene, well, camera.read_noise)
    _check(times, noise, scene, well, auto)
    return Metered(times, scene, noise)


def scout_poses(n_poses: int) -> list[int]:
    """Return the poses to look at: the first, the last and some evenly between."""
    return sorted({round(i) for i in np.linspace(0, n_poses - 1, min(N_SCOUTS, n_poses))})


def fewest_exposures(
    scene: SceneRange, bound: float, well: float, read_noise: float, limits: tuple[float, float]
) -> tuple[float, ...]:
    """Return the fewest exposure times, seconds, ascending, that keep the relative noise within `bound`.

    Parameters
    ----------
    scene : SceneRange
        Electrons per second.
    bound : float
        Largest relative noise.
    well, read_noise : float
        Electrons that an exposure may collect, and the standard deviation of reading them.
    limits : tuple of float
        Shortest and longest exposure time, seconds; where they stand in the way, the best within them.
    """
    shortest, longest = limits
    times = [min(max(well / scene.brightest, shortest), longest)]
    while _information(times, scene.darkest, read_noise) < 1.0 / bound**2 and times[-1] < longest:
        # Where the next one clips, the others must do.
        L = _least_radiance(times, bound, read_noise)
        following = min(well / L, longest)
        if following <= times[-1] * 1.05:
            break
        times.append(following)
    return tuple(times)


def largest_noise(times: Sequence[float], scene: SceneRange, well: float, read_noise: float) -> float:
    """Return the largest relative noise of the merged radiance over the range of a scene."""
    # It is largest at the dark end, and just above each radiance at which an exposure clips.
    edges = [well / time * (1.0 + 2.0 * _ROUNDING) for time in times]
    radiances = [scene.darkest, *(L for L in edges if scene.darkest < L < scene.brightest)]
    worst = min(_information([t for t in times if t * L <= well * (1.0 + _ROUNDING)], L, read_noise) for L in radiances)
    return 1.0 / math.sqrt(worst) if worst > 0.0 else math.inf


def _information(times: Iterable[float], L: float, r: float) -> float:
    """Return the sum of e^2 / (e + r^2) over exposures of e = L t electrons."""
    return sum((L * t) ** 2 / (L * t + r * r) for t in times)


def _least_radiance(times: Sequence[float], bound: float, read_noise: float) -> float:
    """Return the least radiance at which all `times` together keep the bound; information grows with radiance."""
    low, high = 0.0, 1.0
    while _information(times, high, read_noise) < 1.0 / bound**2:
        high *= 2.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _information(times, middle, read_noise) >= 1.0 / bound**2 else (middle, high)
    return high


def _scout(rig: Rig, target: dict[str, float], shortest: float, longest: float, auto: AutoConfig) -> SceneRange:
    camera = rig.camera.describe()
    ladder = _ladder(shortest, longest)
    move_verified(rig.stage, target)
    rate = np.full((camera.height, camera.width), np.nan)
    with light_on(rig.light, rig.config.light.level, lease_seconds(ladder)):
        for time in ladder:
            _read_rates(rate, take_shot(rig.camera, rig.light, 0, time).frame.counts, time, camera)
    return _range(rate, camera, shortest, longest, auto)


def _ladder(shortest: float, longest: float) -> tuple[float, ...]:
    n = max(1, math.ceil(math.log(longest / shortest, _SCOUT_RATIO))) if longest > shortest else 0
    return tuple(shortest * (longest / shortest) ** (k / n) for k in range(n + 1)) if n else (shortest,)


def _read_rates(rate: NDArray[np.float64], counts: NDArray[np.uint16], time: float, camera: CameraDescription) -> None:
    """Fill in electrons per second of every pixel that this exposure does not clip."""
    fits = counts < 0.95 * camera.saturation_level
    rate[fits] = (counts[fits] - camera.black_level) * camera.conversion_gain / time


def _range(
    rate: NDArray[np.float64], camera: CameraDescription, shortest: float, longest: float, auto: AutoConfig
) -> SceneRange:
    full = (camera.saturation_level - camera.black_level) * camera.conversion_gain
    # What clips in the shortest scout is brighter than that by an unknown amount.
    known = np.where(np.isnan(rate), full / shortest, rate)
    darkest = float(np.quantile(known, auto.darkest_percent / 100.0))
    brightest = float(np.quantile(known, 1.0 - _GLINTS))
    # Below one standard deviation of the read-out in the longest exposure there is nothing to measure.
    floor = camera.read_noise / longest
    return SceneRange(max(darkest, floor), max(brightest, darkest, floor))


def _rounded(time: float) -> float:
    """Return `time` with three digits, downwards: it must not clip."""
    step = 10.0 ** (math.floor(math.log10(time)) - 2)
    return round(math.floor(time / step + 1e-9) * step, 12)


def _check(times: tuple[float, ...], noise: float, scene: SceneRange, well: float, auto: AutoConfig) -> None:
    reasons = []
    if len(times) > auto.most_exposures:
        reasons.append(f"it takes {len(times)} exposures ({', '.join(f'{t:g}' for t in times)} s)")
    if noise > auto.noise:
        reasons.append(f"{len(times)} exposures within the limits reach {noise:.3g}")
    if scene.brightest * times[0] > well * 1.3:
        reasons.append("the brightest parts clip in the shortest exposure allowed")
    if reasons:
        raise UnsafeError(
            f"bracket.auto asks for a noise of {auto.noise:g} with at most {auto.most_exposures} exposures of "
            f"{auto.shortest_s:g} to {auto.longest_s:g} s: {'; '.join(reasons)}. Allow more noise, more or other "
            "exposures, or leave out more of the darkest pixels (darkest_percent)"
        )
