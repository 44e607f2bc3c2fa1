"""Pictures that are already registered to the sample plane, and a table of where camera and light stood."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.registration.lighting import looking_at_centre
from analysis.registration.positions import Placement, read_positions
from analysis.registration.stack import Stack
from instrument.files.validation import Problem, raise_if_any
from instrument.pictures.reading import LINEAR_SUFFIXES, is_raw, read_picture

Array = NDArray[np.float64]

MIN_SIDE = 2
"""Pixels; a single row or column has no relief to find."""

_RELATIVE_NOISE = 0.005  # shot noise of a consumer sensor in a bright pixel; the solver finds the rest
_FLOAT_STEP = 1e-4  # of the typical radiance: what a picture of floating-point numbers may be off in its dark

_CLOSEST = 0.2
"""Distance of a camera over the width of the area, below which its unit must be wrong: it would see 136 deg."""


@dataclass(frozen=True, slots=True)
class _Picture:
    """Values of a picture, shape (height, width, 1 or 3) in R, G, B.

    `step` is from one value to the next where the file holds whole numbers, whose largest is made 1; 0 for
    floating-point numbers, which nothing says to be clipped.
    """

    values: NDArray[np.float32]
    step: float


def import_registered(folder: Path, positions: Path, width_mm: float, gamma: float | None, binning: int) -> Stack:
    """Read pictures of one area, registered to the plane z = 0, into a registered stack.

    The cameras' rotation is taken as level and looking at the centre, since the table does not state it; it
    only serves to express a light offset that the reconstruction estimates.

    Parameters
    ----------
    folder : Path
        Holds the pictures that the table names.
    positions : Path
        CSV with a header: ``file``, ``camera_x_mm``, ``camera_y_mm``, ``camera_z_mm`` (or ``_cm``, ``_m``) and
        optionally ``light_x_mm``, ``light_y_mm``, ``light_z_mm``; without a light it is where the camera is. Tables
        with semicolons may have decimal commas. Or an ``.lp`` file of a dome's light directions.
    width_mm : float
        Width of the area that a picture shows.
    gamma : float or None
        The pictures are linear radiance to the power 1 / gamma; None = not stated, which only formats that are
        always linear (EXR, HDR, PFM, NumPy) may leave out. 1 = linear.
    binning : int
        Average squares of so many pixels a side.

    Raises
    ------
    InvalidInputError
        With everything that is wrong with the table and the pictures, by line.
    """
    title = f"{folder} cannot be imported."
    if not (np.isfinite(width_mm) and width_mm > 0.0):
        raise_if_any(title, [Problem("width_mm", f"is {width_mm}; must be a positive number of mm")])
    placements, problems = read_positions(positions)
    raise_if_any(title, problems or _distance_problems(positions, placements, width_mm))
    raise_if_any(title, _picture_problems(folder, positions, placements, gamma))
    pictures = [_read_picture(folder / p.file) for p in placements]
    raise_if_any(title, _size_problems(positions, placements, pictures, binning))
    level = float(np.median(np.concatenate([p.values[::7, ::7].ravel() for p in pictures])))
    linear, variance, clipped = zip(
        *(_linearise(picture, gamma or 1.0, binning, level) for picture in pictures), strict=True
    )
    camera = np.stack([p.camera for p in placements])
    return Stack(
        radiance=np.stack(linear),
        variance=np.stack(variance),
        saturated=np.stack(clipped),
        camera_position=camera,
        light_position=np.stack([p.light for p in placements]),
        light_power=np.array([p.power for p in placements]),
        pixel_pitch=width_mm / pictures[0].values.shape[1] * binning,
        camera_rotation=looking_at_centre(camera),
    )


def _distance_problems(positions: Path, placements: list[Placement], width_mm: float) -> Iterator[Problem]:
    for placement in placements:
        distance = float(np.linalg.norm(placement.camera))
        if distance < _CLOSEST * width_mm:
            what = (
                f"{placement.file}: the camera is {distance:.3g} mm from the centre of an area {width_mm:g} mm wide. "
                "In metres or centimetres? Name the columns camera_x_m ... or camera_x_cm ..., or correct the width"
            )
            yield Problem(f"{positions}:{placement.line}", what)


def _picture_problems(
    folder: Path, positions: Path, placements: list[Placement], gamma: float | None
) -> Iterator[Problem]:
    for placement in placements:
        path = folder / placement.file
        where = f"{positions}:{placement.line}"
        if not path.is_file():
            yield Problem(where, f"{placement.file} is not in {folder}")
        elif gamma is None and path.suffix.lower() not in LINEAR_SUFFIXES:
            yield Problem(
                where,
                f"{placement.file} may not be linear; state --gamma (2.2 for pictures made for display, 1 if linear)",
            )
        else:
            try:
                _read_picture(path)
            except (OSError, ValueError, RuntimeError) as error:
                yield Problem(where, f"{placement.file} cannot be read as a picture ({error})")


def _size_problems(
    positions: Path, placements: list[Placement], pictures: list[_Picture], binning: int
) -> Iterator[Problem]:
    first = pictures[0].values.shape
    for placement, picture in zip(placements, pictures, strict=True):
        if picture.values.shape != first:
            text = f"{placement.file} has {picture.values.shape}; the first picture has {first}, and all must be alike"
            yield Problem(f"{positions}:{placement.line}", text)
    if min(first[:2]) < binning:
        yield Problem("--bin", f"is {binning}; pictures have {first[1]} x {first[0]} pixels")


def _read_picture(path: Path) -> _Picture:
    """Read a picture; whole numbers are scaled so that the largest of their type is 1."""
    picture = None if is_raw(path) else read_picture(path)
    if picture is None or picture.bayer_pattern:
        raise ValueError("a RAW file is a mosaic, which cannot be registered; develop it linearly and save it as TIFF")
    if picture.orientation in range(2, 9):  # some cameras write 0 for "not known"
        raise ValueError(f"is to be turned when it is shown (orientation {picture.orientation}); save it upright")
    values = picture.pixels
    if values.ndim == 2:
        values = values[..., None]
    if min(values.shape[:2]) < MIN_SIDE:
        height, width = values.shape[:2]
        raise ValueError(f"has {width} x {height} pixels; needed are {MIN_SIDE} at least a side, or it has no slopes")
    whole = values.dtype.kind in "iu"
    scale = (picture.saturation_level or np.iinfo(values.dtype).max) if whole else 1.0
    return _Picture(np.ascontiguousarray(values, np.float32) / np.float32(scale), 1.0 / scale if whole else 0.0)


def _linearise(
    picture: _Picture, gamma: float, binning: int, level: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    """Undo the display curve; return radiance, variance (quantisation and shot noise) and what is clipped.

    `level` is the typical value of all pictures; floating-point pictures may have any unit, so that only it tells
    what is dark.
    """
    values = picture.values
    linear = np.maximum(values, 0.0) ** gamma
    if picture.step > 0.0:
        # The largest value that the type holds may stand for any light above it.
        clipped = values >= 1.0 - 0.5 * picture.step
        # One step of the type, seen through the slope of the curve.
        step = gamma * np.maximum(values, picture.step) ** (gamma - 1.0) * picture.step
    else:
        clipped = np.zeros(values.shape, np.bool_)
        step = np.full(values.shape, np.float32(_FLOAT_STEP * max(level, 0.0) ** gamma))
    variance = step**2 + (_RELATIVE_NOISE * linear) ** 2
    n = binning**2
    return (
        _bin(linear, binning).astype(np.float32),
        (_bin(variance, binning) / n).astype(np.float32),
        (_bin(clipped.astype(np.float32), binning) > 0.0).astype(np.uint8),
    )


def _bin(values: NDArray[np.floating], binning: int) -> NDArray[np.floating]:
    height, width, channels = values.shape
    rows, columns = height // binning, width // binning
    cut = values[: rows * binning, : columns * binning]
    return np.asarray(cut.reshape(rows, binning, columns, binning, channels).mean(axis=(1, 3)))
