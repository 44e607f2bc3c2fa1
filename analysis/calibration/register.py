"""Writes the registered stack of a session: calibrates it, then resamples view by view onto the sample plane."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.light import Lighting, evened, stack_geometry
from analysis.calibration.nominal import nominal_setup
from analysis.calibration.session import Calibration, calibrate_session
from analysis.camera.calibration import CameraCalibration, footprint_mm, views_of
from analysis.radiometry.frames import MergedFrames
from analysis.registration.grid import Grid
from analysis.registration.rectification import rectify
from analysis.registration.stack_file import StackWriter
from analysis.stages import Stages
from instrument.session.session import Session

Array = NDArray[np.float64]

GRID_PER_PIXEL = 1.3
"""Default pitch of the grid in pixels of the picture: a mosaic does not resolve more than that."""


def register(session: Session, path: Path, pitch: float | None = None, stages: Stages | None = None) -> Calibration:
    """Calibrate a session from its own pictures and write it to `path`, resampled onto the sample plane.

    No more than one picture and one view of the stack are in memory at a time.

    Parameters
    ----------
    session : Session
    path : Path
        Of the stack; there must be no such file.
    pitch : float or None
        Size of a pixel of the stack, mm; None = as stated with the capture, or as fine as the pictures.
    stages : Stages or None

    Returns
    -------
    Calibration
        With camera and lighting.

    Raises
    ------
    InvalidInputError
        If something needed is not stated, or too few poses show the boards.
    FileExistsError
        If there is a file already.
    """
    stages = stages or Stages()
    nominal = nominal_setup(session)
    frames = MergedFrames(session)
    calibration = calibrate_session(session, frames, stages)
    assert calibration.camera is not None, "an area without boards is refused by `nominal_setup`"
    assert calibration.lighting is not None
    with stages.measure("registration"):
        as_fine_as_seen = round(GRID_PER_PIXEL * footprint_mm(calibration.camera), 3)
        grid = Grid.covering(nominal.area_mm, pitch or session.nominal.pixel_pitch_mm or as_fine_as_seen)
        notes = {"calibration": json.dumps(calibration.as_dict()), "session_digest": session.digest()}
        _write_registered(frames, calibration, calibration.camera, calibration.lighting, grid, path, notes, stages)
    return calibration


def _write_registered(
    frames: MergedFrames,
    calibration: Calibration,
    camera: CameraCalibration,
    lighting: Lighting,
    grid: Grid,
    path: Path,
    notes: dict[str, str],
    stages: Stages,
) -> None:
    stack = stack_geometry(lighting.photometry, lighting.light_offset, camera, grid, len(lighting.white_level))
    points = grid.points()
    with StackWriter(path, replace(stack, notes=notes)) as writer:
        views = list(zip(calibration.i_pose, views_of(camera), strict=True))
        for v, (i_pose, view) in enumerate(stages.track(views)):
            merged = frames.merge(int(i_pose))
            picture = (merged.mean, merged.variance, merged.saturated, frames.bayer_pattern, view)
            seen = evened(rectify(*picture, points, grid.pitch), calibration.flat, view, points)
            falloff = lighting.photometry.falloff(view, lighting.light_offset.value, points, seen.pixels)
            seen = seen.scaled(1.0 / (falloff[..., None] * lighting.white_level))
            writer.write_view(v, seen.radiance, seen.variance, seen.saturated)
