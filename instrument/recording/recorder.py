"""Writes a session file pose by pose, so that a kill at any moment loses one pose at most."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from instrument.files.digests import chain_digest, frame_digest
from instrument.files.new_hdf5 import abandon, release, reserve, sync
from instrument.files.whole_file import check_space, system_number
from instrument.recording.creation import HDF5_FORMAT
from instrument.session import layout
from instrument.session.audit import event_line
from instrument.session.layout import Field, Status
from instrument.session.preview import fraction, preview
from instrument.session.records import PoseRecord

# Room for HDF5's own bookkeeping and some lines of the journal, besides the pictures that are written at a time.
_BOOKKEEPING = 2**19


class Recorder:
    """Fills a session that `create_session` made; the file is locked against other writers.

    Parameters
    ----------
    path : Path
        The session.

    Raises
    ------
    OSError
        If the file cannot be opened, for one because another process writes it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: h5py.File | None = None
        file = self._file = _open_alone(path)
        started = datetime.fromisoformat(file[layout.START_TIME.path].asstr()[()])
        # From here on time runs by the monotonic clock; the wall clock only joins the parts of a session.
        offset = (datetime.now(UTC) - started).total_seconds()
        self._monotonic_start = time.monotonic_ns() - round(offset * 1e9)
        with self._writing():
            self._write(layout.STATUS, Status.RECORDING)
            self._write(layout.END_TIME, "")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(Status.INTERRUPTED)

    def write_darks(
        self,
        mean: NDArray[np.float32],
        variance: NDArray[np.float32],
        when_ns: list[int],
        temperature: list[float] | None = None,
    ) -> None:
        """Write the dark frames.

        Parameters
        ----------
        mean, variance : ndarray of float32, shape (E, H, W) or (E, H, W, 3)
            Of the counts, and of a single frame's.
        when_ns : list of int, length E
            When the last of each exposure had been read (monotonic).
        temperature : list of float, length E, optional
            Of the sensor, degrees Celsius; None where the session has no place for it.
        """
        with self._writing(mean.nbytes + variance.nbytes):
            self._write(layout.DARK, mean)
            self._write(layout.DARK_VARIANCE, variance)
            if temperature is not None:
                self._write(layout.DARK_TEMPERATURE, temperature)
            # The times say that the darks are whole, so they reach the disk after them.
            self._sync()
            self._write(layout.DARK_TIMESTAMP, self._seconds(np.asarray(when_ns)))

    def write_flats(self, frames: NDArray[np.uint16], exposure_times: list[float]) -> None:
        """Write the frames of an even plane, shape (F, H, W), counts, with their exposure times in seconds."""
        check_space(self._path, frames.nbytes)
        with self._writing(frames.nbytes):
            for i, frame in enumerate(frames):
                self._write(layout.FLAT_IMAGES, frame, i)
            # The times say that the frames are whole, so they reach the disk after them.
            self._sync()
            self._write(layout.FLAT_TIME, exposure_times)

    def write_pose(self, i_pose: int, record: PoseRecord, events: Sequence[str] = ()) -> None:
        """Write one pose and then mark it complete, each flushed: a reader never sees half a pose.

        Parameters
        ----------
        i_pose : int
        record : PoseRecord
        events : sequence of str
            Lines of the journal that go with it, as `write_events` takes them.

        Raises
        ------
        OSError
            If the disk is full or fails.
        """
        check_space(self._path, record.counts.nbytes)
        with self._writing(record.counts.nbytes) as file:
            self._write_frames(i_pose, record)
            self._write_settings(i_pose, record)
            self._append_events(events)
            file.flush()
            self._write(layout.POSE_COMPLETE, 1, i_pose)

    def write_beside(self, field: Field, i: int, picture: NDArray[np.uint16] | NDArray[np.float32]) -> None:
        """Write picture `i` of those beside the poses: of ambient light, of a flat field, for the response."""
        check_space(self._path, picture.nbytes)
        with self._writing(picture.nbytes):
            self._write(field, picture, i)

    def note(self, event: str, **details: object) -> None:
        """Append a line to the journal's events; it reaches the disk with the next pose, or on closing."""
        self.write_events([event_line(event, details)])

    def write_events(self, lines: Sequence[str]) -> None:
        """Append lines that `instrument.session.audit` made, as `note` does."""
        if self._file and lines:
            with self._writing():
                self._append_events(lines)

    def close(self, status: Status) -> None:
        """Write how it ended and when, and close; does nothing the second time."""
        if not self._file:
            return
        try:
            with self._writing():
                self._write(layout.STATUS, status)
                self._write(layout.END_TIME, datetime.now(UTC).isoformat())
        finally:
            # Nothing waits to be written, unless the file was abandoned.
            if self._file:
                self._file.close()

    def abandon(self) -> None:
        """Touch the file no more; what is complete is on the disk."""
        if self._file:
            abandon(self._file)
        self._file = None

    @contextmanager
    def _writing(self, n_bytes: int = 0) -> Iterator[h5py.File]:
        """Give the file to write `n_bytes` of pictures to, and hand them to the disk after the block.

        A file that fails all the same is abandoned, since HDF5 may crash when it is touched again.

        Raises
        ------
        OSError
            If the file was abandoned or is closed, or cannot be written now.
        """
        file = self._file
        if not file:
            raise OSError(errno.EBADF, f"{self._path} is not open to write: a write failed before, or it was closed")
        # Pictures that do not compress grow by a little.
        reserve(file, n_bytes + n_bytes // 100 + _BOOKKEEPING)
        try:
            yield file
            sync(file)
            release(file)
        except (OSError, RuntimeError) as error:
            self.abandon()
            raise _as_os_error(error, self._path) from error

    def _write_frames(self, i_pose: int, record: PoseRecord) -> None:
        # Whole numbers where they are some: to compare counts with floating-point numbers takes ten times as long.
        black, saturation = (_whole(self._read(field)) for field in (layout.BLACK_LEVEL, layout.SATURATION))
        at = (i_pose, record.i_exposure)
        digests = [frame_digest(frame) for frame in record.counts]
        saturated = fraction(record.counts >= saturation)
        for i_exposure, frame in zip(record.i_exposure, record.counts, strict=True):
            self._write(layout.IMAGES, frame, (i_pose, i_exposure))
        self._write(layout.FRAME_OK, 1, at)
        self._write(layout.FRAME_DIGEST, np.asarray(digests, "S64"), at)
        self._write(layout.POSE_DIGEST, chain_digest(digests), i_pose)
        self._write(layout.SATURATED_FRACTION, saturated, at)
        self._write(layout.BLACK_FRACTION, fraction(record.counts <= black), at)
        small = preview(record.counts, record.exposure_readback, black, saturated)
        self._write(layout.PREVIEW, small, i_pose)

    def _write_settings(self, i_pose: int, record: PoseRecord) -> None:
        at = (i_pose, record.i_exposure)
        self._write(layout.EXPOSURE_READBACK, record.exposure_readback, at)
        self._write(layout.SENSOR_TEMPERATURE, record.sensor_temperature, at)
        self._write(layout.MONOTONIC, record.monotonic_ns, at)
        self._write(layout.TIMESTAMP, self._seconds(record.monotonic_ns), at)
        self._write(layout.LEVEL_SET, record.level_set, at)
        self._write(layout.LEVEL_READBACK, record.level_readback, at)
        self._write(layout.MONITOR, record.monitor, at)
        self._write(layout.LIGHT_TEMPERATURE, record.light_temperature, at)
        self._write(layout.ATTEMPTS, record.attempts, i_pose)
        if self._has(layout.REFERENCE):
            self._write(layout.REFERENCE, record.reference, i_pose)
        for axis, position in record.positions.items():
            self._write(layout.axis_field(axis, "value"), position, i_pose)

    def _append_events(self, lines: Sequence[str]) -> None:
        if lines:
            events = self._open[layout.EVENTS.path]
            events.resize(events.shape[0] + len(lines), axis=0)
            events[-len(lines) :] = np.array([line.encode() for line in lines], dtype=events.dtype)

    def _write(self, field: Field, value: object, at: object = ()) -> None:
        self._open[field.path][at] = value

    def _read(self, field: Field) -> Any:
        return self._open[field.path][()]

    def _has(self, field: Field) -> bool:
        return field.path in self._open

    def _sync(self) -> None:
        sync(self._open)

    @property
    def _open(self) -> h5py.File:
        assert self._file is not None
        return self._file

    def _seconds(self, monotonic_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        since_start = (monotonic_ns - self._monotonic_start) / 1e9
        return np.where(monotonic_ns > 0, since_start, np.nan)


def _whole(level: float) -> int | float:
    return int(level) if float(level).is_integer() else float(level)


def _as_os_error(error: Exception, path: Path) -> OSError:
    """Return an error of HDF5, which hides the system's number in its text, as one of the system."""
    number = system_number(error) or errno.EIO
    return OSError(number, f"{path} cannot be written: {os.strerror(number)}")


def _open_alone(path: Path) -> h5py.File:
    """Open `path` to write, unless anyone else has it open to write, or this very process at all."""
    try:
        _refuse_open_here(path)
        return h5py.File(path, "r+", libver=HDF5_FORMAT)
    except OSError as error:
        why = "another process is writing it" if isinstance(error, BlockingIOError) else str(error)
        message = f"{path} cannot be written: {why}. Close it there, then try again"
        raise OSError(error.errno, message) from None


def _refuse_open_here(path: Path) -> None:
    # HDF5's lock keeps out other processes only; within one it would share the file without a word.
    open_files = h5py.h5f.get_obj_ids(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE)
    if any(Path(os.fsdecode(file.name)).resolve() == path.resolve() for file in open_files):
        raise OSError("it is open in this program already")
