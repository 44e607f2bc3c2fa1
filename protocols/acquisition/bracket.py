"""Takes the bracket of one pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from instrument.rig.rig import Rig
from instrument.session.records import PoseRecord
from protocols.acquisition.frame_checks import (
    check_growth,
    check_lit_and_dark_again,
    check_order,
    clips,
    frame_to_repeat,
)
from protocols.acquisition.reference_patch import ReferencePatch
from protocols.acquisition.shot import Shot, expose, lease_seconds, light_on, move_verified, take_shot


@dataclass(frozen=True, slots=True)
class Bracket:
    """The exposures of every pose, and what is known for checking them.

    Attributes
    ----------
    times : tuple of float, length E
        Seconds, ascending.
    n_spare : int
        The first so many are taken only where the next one clips.
    darkness : tuple of float, length E
        Mean counts of a frame in the dark, per exposure time.
    """

    times: tuple[float, ...]
    n_spare: int
    darkness: tuple[float, ...]


def take_pose(
    rig: Rig, target: Mapping[str, float], bracket: Bracket, attempt: int, patch: ReferencePatch | None = None
) -> PoseRecord:
    """Move to `target`, take the bracket in the light, and make sure that it was lit and is dark again.

    Parameters
    ----------
    rig : Rig
    target : mapping of str to float
        Position of each axis, degrees or millimetres.
    bracket : Bracket
    attempt : int
        How often this pose was begun, for the record.
    patch : ReferencePatch, optional
        Where to read the drift from.

    Raises
    ------
    DeviceError
        If any device fails or does not confirm what it was told; the light was told to go off then.
    """
    positions = move_verified(rig.stage, target)
    return _record(rig, take_bracket(rig, bracket), positions, attempt, patch)


def take_bracket(rig: Rig, bracket: Bracket) -> list[Shot]:
    """Take the bracket where the stage stands, in the light; return its shots, exposure times ascending.

    Raises
    ------
    DeviceError
        As `take_pose`.
    """
    with light_on(rig.light, rig.config.light.level, lease_seconds(bracket.times)):
        shots = _take_shots(rig, bracket)
    check_order([shot.frame.sequence_number for shot in shots])
    shots.sort(key=lambda shot: shot.i_exposure)
    _check(rig, shots, bracket)
    return shots


def _take_shots(rig: Rig, bracket: Bracket) -> list[Shot]:
    """Return the shots in the order they were taken."""
    regular = range(bracket.n_spare, len(bracket.times))
    shots = [take_shot(rig.camera, rig.light, i, bracket.times[i]) for i in regular]
    if bracket.n_spare and clips(shots[0].frame, rig.camera.describe()):
        shots += [take_shot(rig.camera, rig.light, i, bracket.times[i]) for i in range(bracket.n_spare)]
    return shots


def _check(rig: Rig, shots: list[Shot], bracket: Bracket) -> None:
    """Take one more frame, in the dark, and hold the pictures of a bracket against each other and against it."""
    camera = rig.camera.describe()
    for shorter, longer in pairwise(shots):
        check_growth(shorter, longer, bracket.darkness, camera.saturation_level)
    shot = frame_to_repeat(shots, bracket.darkness, camera)
    after = expose(rig.camera, bracket.times[shot.i_exposure])
    check_lit_and_dark_again(shot, after, bracket.darkness[shot.i_exposure], camera)


def _record(
    rig: Rig,
    shots: list[Shot],
    positions: Mapping[str, float],
    attempt: int,
    patch: ReferencePatch | None,
) -> PoseRecord:
    counts = np.stack([shot.frame.counts for shot in shots])
    times = np.array([shot.frame.exposure_time for shot in shots])
    return PoseRecord(
        i_exposure=np.array([shot.i_exposure for shot in shots]),
        counts=counts,
        exposure_readback=times,
        sensor_temperature=np.array([shot.frame.sensor_temperature for shot in shots]),
        monotonic_ns=np.array([shot.monotonic_ns for shot in shots]),
        level_set=rig.config.light.level,
        level_readback=np.array([shot.light.level for shot in shots]),
        monitor=np.array([shot.light.monitor for shot in shots]),
        light_temperature=np.array([shot.light.temperature for shot in shots]),
        positions=positions,
        attempts=attempt,
        reference=np.nan if patch is None else patch.brightness(counts, times, positions),
    )
