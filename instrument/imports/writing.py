"""Writes surveyed pictures into a session, one pose at a time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import refuse_unreadable, written_whole
from instrument.imports.arrangement import Frame
from instrument.imports.header import pictures_beside, session_header
from instrument.imports.prepare import Import
from instrument.imports.survey import Watcher
from instrument.pictures.picture import UnreadablePictureError
from instrument.pictures.reading import read_picture
from instrument.recording.creation import create_session, refuse_existing
from instrument.recording.recorder import Recorder
from instrument.session import layout
from instrument.session.layout import Status
from instrument.session.records import PoseRecord
from instrument.session.session import Session


def write_import(prepared: Import, path: Path, watch: Watcher = lambda done, total, name: None) -> None:
    """Write a session at `path`; it appears there whole or not at all.

    Parameters
    ----------
    prepared : Import
    path : Path
    watch : callable, optional
        Told how many of how many poses have been written, and the name of the next picture.

    Raises
    ------
    SessionExistsError
        If there is a file at `path`.
    InvalidInputError
        If a picture has changed since it was looked at.
    OSError
        If the disk is too small, or writing fails.
    """
    refuse_existing(path)
    with written_whole(path) as part:
        create_session(part, session_header(prepared), _planned_bytes(prepared))
        with Recorder(part) as recorder:
            _write_poses(recorder, prepared, watch)
            _write_beside(recorder, prepared)
            recorder.close(Status.COMPLETE)
        # Structure alone: each frame was hashed when it was written, and to unpack all of them again takes long.
        refuse_unreadable(path, part, lambda written: Session(written).close())


def _write_poses(recorder: Recorder, prepared: Import, watch: Watcher) -> None:
    poses = prepared.arrangement.poses
    for i_pose, pose in enumerate(poses):
        watch(i_pose, len(poses), pose[0].pick.name)
        recorder.write_pose(i_pose, _record(prepared, i_pose))
    watch(len(poses), len(poses), "")


def _record(prepared: Import, i_pose: int) -> PoseRecord:
    """Return the frames of a pose; what a camera's file does not tell is NaN."""
    pose = prepared.arrangement.poses[i_pose]
    unknown = np.full(len(pose), np.nan)
    return PoseRecord(
        i_exposure=np.array(prepared.arrangement.indices(i_pose)),
        counts=np.stack([_counts(frame, prepared) for frame in pose]),
        exposure_readback=np.array([frame.exposure_time for frame in pose]),
        sensor_temperature=unknown,
        monotonic_ns=np.zeros(len(pose), np.int64),
        level_set=float("nan"),
        level_readback=unknown,
        monitor=unknown,
        light_temperature=unknown,
        positions={},
        attempts=1,
    )


def _write_beside(recorder: Recorder, prepared: Import) -> None:
    for field, frames in pictures_beside(prepared.arrangement).items():
        for i, frame in enumerate(frames):
            recorder.write_beside(field, i, _counts(frame, prepared))
    if prepared.arrangement.darks:
        for i_exposure in range(len(prepared.arrangement.exposure_times)):
            mean, variance = _mean_and_variance(prepared.arrangement.darks_of(i_exposure), prepared)
            recorder.write_beside(layout.DARK, i_exposure, mean)
            recorder.write_beside(layout.DARK_VARIANCE, i_exposure, variance)
            recorder.write_beside(layout.DARK_TIMESTAMP, i_exposure, np.zeros((), np.float32))


def _mean_and_variance(darks: Sequence[Frame], prepared: Import) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return mean and variance of one frame, by Welford's recurrence: one frame in memory at a time."""
    mean = np.zeros(prepared.sensor.camera.frame_shape)
    squares = np.zeros_like(mean)
    for n, dark in enumerate(darks, start=1):
        deviation = _counts(dark, prepared) - mean
        mean += deviation / n
        squares += deviation**2 * (1 - 1 / n)
    variance = squares / (len(darks) - 1) if len(darks) > 1 else np.full_like(mean, np.nan)
    return mean.astype(np.float32), variance.astype(np.float32)


def _counts(frame: Frame, prepared: Import) -> NDArray[Any]:
    """Return the values of a frame as the session holds them."""
    try:
        pixels = read_picture(frame.pick.path).pixels
    except UnreadablePictureError as error:
        raise InvalidInputError("Nothing was written", [Problem(frame.pick.name, str(error))]) from error
    if pixels.shape != frame.surveyed.shape or pixels.dtype.str[1:] != frame.surveyed.dtype:
        problem = Problem(frame.pick.name, "was changed while it was imported; import again")
        raise InvalidInputError("Nothing was written", [problem])
    return pixels if pixels.dtype.kind == "f" else pixels.astype(np.uint16) >> np.uint16(prepared.sensor.shift)


def _planned_bytes(prepared: Import) -> int:
    """Return the bytes that the session may need: frames uncompressed, previews, tables."""
    arrangement, camera = prepared.arrangement, prepared.sensor.camera
    n_frames = len(arrangement.frames) + sum(map(len, pictures_beside(arrangement).values()))
    values = int(np.prod(camera.frame_shape))
    darks = 8 * len(arrangement.exposure_times) * values if arrangement.darks else 0
    return int(n_frames * values * np.dtype(camera.dtype).itemsize) + darks + 1_000_000
