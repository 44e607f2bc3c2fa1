"""Writes a session as a folder of pictures with a `capture.toml`, which `halfangle import` reads back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import refuse_unreadable, write_whole, written_whole
from instrument.imports.capture_text import Beside, Exported, capture_text
from instrument.imports.prepare import CAPTURE_FILE, prepare_import
from instrument.pictures.dng import write_dng, write_float_tiff
from instrument.session.session import Session

Watcher = Callable[[int, int, str], None]


def export_session(session: Session, folder: Path, watch: Watcher = lambda done, total, name: None) -> int:
    """Write the complete poses of a session into a new folder, whole or not at all.

    Counts become uncompressed DNG, floating-point frames and the means of dark frames TIFF; everything else that
    an import can state stands in `capture.toml`.

    Parameters
    ----------
    session : Session
    folder : Path
        There must be nothing at that place.
    watch : callable, optional
        Told how many of how many poses have been written.

    Returns
    -------
    int
        How many pictures the folder holds.

    Raises
    ------
    FileExistsError
        If there is something at `folder`.
    InvalidInputError
        If no pose is complete, a frame cannot be decoded, or an import would refuse the folder.
    NotWrittenError
        If the disk or the folder beside does not take it.
    """
    with written_whole(folder) as part:
        part.mkdir()
        exporter = _Exporter(session, part)
        exported = exporter.write_all(watch)
        write_whole(part / CAPTURE_FILE, capture_text(session, exported))
        refuse_unreadable(folder, part, lambda read: prepare_import(read, read / CAPTURE_FILE))
    return exporter.n_written


class _Exporter:
    """Writes the pictures of one session and remembers their names."""

    def __init__(self, session: Session, folder: Path) -> None:
        self.session, self.folder, self.camera = session, folder, session.camera
        cell = session.nominal.black_level_cell
        self.black_level = np.full((2, 2), self.camera.black_level) if cell is None else cell
        self.n_written = 0

    def write_all(self, watch: Watcher) -> Exported:
        i_poses = np.flatnonzero(self.session.pose_complete).tolist()
        if not i_poses:
            problem = Problem(str(self.session.path), "no pose is complete; go on with `halfangle resume`")
            raise InvalidInputError("Nothing was exported", [problem])
        ambient = [self._ambient(i_pose) for i_pose in i_poses]
        poses = []
        for n, i_pose in enumerate(i_poses):
            watch(n, len(i_poses), f"pose {i_pose}")
            poses.append(self._pose(i_pose))
        watch(len(i_poses), len(i_poses), "")
        return Exported(tuple(poses), tuple(ambient), self._darks(), self._flats(), self._response(), self._curve())

    def _pose(self, i_pose: int) -> Beside:
        times = self.session.exposure_readback[i_pose]
        names = {
            self._write(f"pose_{i_pose:04d}_{i}", self.session.frame(i_pose, i), times[i]): float(times[i])
            for i in np.flatnonzero(self.session.frame_ok[i_pose]).tolist()
        }
        return Beside(tuple(names), tuple(names.values()))

    def _ambient(self, i_pose: int) -> str | None:
        """Return the name of a pose's picture without the light; its exposure time stands in its own tags."""
        picture = self.session.extra.ambient(i_pose)
        if picture is None:
            return None
        return self._write(f"ambient_{i_pose:04d}", picture, self.session.extra.ambient_times[i_pose])

    def _darks(self) -> Beside | None:
        dark, times = self.session.dark, self.session.exposure_times.tolist()
        if dark is None:
            return None
        names = [self._write(f"dark_{i}", frame, times[i]) for i, frame in enumerate(dark)]
        return Beside(tuple(names), tuple(times))

    def _flats(self) -> Beside | None:
        return self._beside("flat", self.session.extra.flat_images, self.session.extra.flat_times)

    def _response(self) -> Beside | None:
        return self._beside("response", self.session.extra.response_images, self.session.extra.response_times)

    def _beside(self, kind: str, picture: Callable[[int], NDArray[Any]], times: NDArray[np.float64]) -> Beside | None:
        if not len(times):
            return None
        names = [self._write(f"{kind}_{i}", picture(i), time) for i, time in enumerate(times.tolist())]
        return Beside(tuple(names), tuple(times.tolist()))

    def _curve(self) -> str | None:
        curve = self.session.nominal.response
        if curve is None:
            return None
        header = "count,linear" if len(curve) == 1 else "count,red,green,blue"
        lines = (",".join(map(repr, [i, *values])) for i, values in enumerate(curve.T.tolist()))
        write_whole(self.folder / "response.csv", "\n".join([header, *lines, ""]))
        return "response.csv"

    def _write(self, stem: str, values: NDArray[Any], exposure_time: float) -> str:
        self.n_written += 1
        if values.dtype.kind == "f":
            write_float_tiff(self.folder / f"{stem}.tif", values, exposure_time, self.camera)
            return f"{stem}.tif"
        write_dng(self.folder / f"{stem}.dng", values, exposure_time, self.camera, self.black_level)
        return f"{stem}.dng"
