"""Session to registered stack: calibrate, then resample view by view onto the sample plane, into the file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.error_budget import ErrorBudget, budget_of
from analysis.merged_frames import MergedFrames
from analysis.rectification import Grid, Rectified, View, rectify
from analysis.session_calibration import Calibration, calibrate_session, footprint_mm, stack_geometry
from analysis.stack_file import StackWriter, read_stack
from analysis.stages import Stages
from analysis.stated import stated
from instrument.session import Session

Array = NDArray[np.float64]

GRID_PER_PIXEL = 1.3
"""Default pitch of the grid in pixels of the picture: a mosaic does not resolve more than that."""


def register(
    session: Session, path: Path, pitch: float | None = None, stages: Stages | None = None
) -> tuple[Calibration, ErrorBudget]:
    """Calibrate a session from its own pictures and write it to `path`, resampled onto the sample plane.

    No more than one picture and one view of the stack are in memory at a time.

    Parameters
    ----------
    session : Session
    path : Path
        Of the stack; there must be no such file.
    pitch : float or None
        Size of a pixel of the stack, mm; None = as fine as the pictures.
    stages : Stages or None

    Raises
    ------
    InvalidInputError
        If there are too few poses, or too few that show the boards.
    FileExistsError
        If there is a file already.
    """
    stages = stages or Stages()
    nominal = stated(session)
    frames = MergedFrames(session)
    calibration = calibrate_session(session, nominal, frames, stages)
    with stages.measure("registration"):
        grid = Grid.covering(
            nominal.area_mm,
            pitch or session.pixel_pitch_mm or round(GRID_PER_PIXEL * footprint_mm(calibration.camera), 3),
        )
        write_registered(frames, calibration, grid, path, {"session_digest": session.digest()})
    with stages.measure("error budget"):
        budget = budget_of(read_stack(path))
    return calibration, budget


def write_registered(
    frames: MergedFrames, calibration: Calibration, grid: Grid, path: Path, notes: dict[str, str]
) -> None:
    """Write the stack of a calibrated session."""
    views, light = calibration.views, calibration.light_offset
    n_channels = len(calibration.white_level)
    stack = stack_geometry(calibration.photometry, light, calibration.camera, grid, n_channels)
    stack = replace(stack, notes={"calibration": json.dumps(calibration.as_dict()), **notes})
    points = grid.points()
    with StackWriter(path, stack) as writer:
        for v, (i_pose, view) in enumerate(zip(calibration.i_pose, views, strict=True)):
            seen = registered_view(frames, int(i_pose), view, calibration, points, grid.pitch)
            writer.write_view(v, seen.radiance, seen.variance, seen.saturated)


def registered_view(
    frames: MergedFrames, i_pose: int, view: View, calibration: Calibration, points: Array, pitch: float
) -> Rectified:
    """Resample one pose onto `points` (H, W, 3) and free it of vignetting, lobe and the colour of white."""
    merged = frames.merge(i_pose)
    seen = rectify(merged.mean, merged.variance, merged.saturated, frames.bayer_pattern, view, points, pitch)
    falloff = calibration.photometry.falloff(view, calibration.light_offset.value, points, seen.pixels)
    return seen.scaled(1.0 / (falloff[..., None] * calibration.white_level))
