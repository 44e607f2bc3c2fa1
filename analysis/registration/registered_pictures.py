"""Pictures that are already registered to the sample plane, and a table of where camera and light stood."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.registration.lighting import looking_at_centre
from analysis.registration.stack import Stack
from instrument.files.validation import Problem, raise_if_any
from instrument.pictures.reading import is_raw, read_picture

Array = NDArray[np.float64]

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}

LINEAR_SUFFIXES = (".exr", ".npy")

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


@dataclass(frozen=True)
class Placement:
    """One row of the table of positions.

    Attributes
    ----------
    file : str
        Name of the picture, relative to the folder.
    camera, light : ndarray, shape (3,)
        Sample frame, mm.
    line : int
        Of the table, for messages.
    """

    file: str
    camera: Array
    light: Array
    line: int


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
        with semicolons may have decimal commas.
    width_mm : float
        Width of the area that a picture shows.
    gamma : float or None
        The pictures are linear radiance to the power 1 / gamma; None = not stated, which only formats that are
        always linear (EXR, NumPy) may leave out. 1 = linear.
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
        light_power=np.ones(len(placements)),
        pixel_pitch=width_mm / pictures[0].values.shape[1] * binning,
        camera_rotation=looking_at_centre(camera),
    )


def read_positions(path: Path) -> tuple[list[Placement], list[Problem]]:
    """Read the table of positions; return its rows and all that is wrong with it."""
    if path.suffix.lower() == ".lp":
        what = (
            "has the light directions of an RTI dome, without camera and distances. Write a CSV with a row a picture: "
            "camera_x_mm, camera_y_mm, camera_z_mm of the fixed camera, light_x_mm ... = direction times distance"
        )
        return [], [Problem(str(path), what)]
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        return [], [Problem(str(path), f"cannot be read ({error})")]
    lines = text.splitlines()
    separator = ";" if lines and ";" in lines[0] else ","
    reader = csv.DictReader(lines, delimiter=separator)
    header = [name.strip() for name in reader.fieldnames or []]
    problems = [Problem(f"{path}:1", what) for what in _header_problems(header)]
    camera, light = _columns(header, "camera"), _columns(header, "light")
    if problems or camera is None:
        return [], problems
    placements: list[Placement] = []
    first_line: dict[str, int] = {}
    for number, row in enumerate(reader, start=2):
        where = f"{path}:{number}"
        if None in row:
            problems.append(Problem(where, _too_many_cells(separator, len(header))))
            continue
        cells = {name: (row[key] or "").strip() for name, key in zip(header, reader.fieldnames or [], strict=True)}
        try:
            at_camera = _position(cells, camera, decimal_comma=separator == ";")
            at_light = _position(cells, light, decimal_comma=separator == ";") if light else at_camera
        except ValueError as error:
            problems.append(Problem(where, f"{error}; positions must be finite numbers with z above the sample"))
            continue
        file = cells["file"]
        if file in first_line:
            problems.append(Problem(where, f"{file} stands in line {first_line[file]} already; keep one of the two"))
        first_line.setdefault(file, number)
        placements.append(Placement(file, at_camera, at_light, number))
    if not placements and not problems:
        problems.append(Problem(str(path), "names no picture"))
    return placements, problems


def _header_problems(header: list[str]) -> Iterator[str]:
    """Yield what is wrong with the names of the columns: what is not understood is not dropped."""
    known = [
        "file",
        *(f"{device}_{axis}_{unit}" for device in ("camera", "light") for unit in UNITS_MM for axis in "xyz"),
    ]
    needed = "file, camera_x_mm, camera_y_mm, camera_z_mm (or _cm, _m), and optionally light_x_mm ..."
    if "file" not in header or _columns(header, "camera") is None:
        yield f"columns are {', '.join(header) or 'none'}; needed are {needed}"
        return
    for name in header:
        if header.count(name) > 1:
            yield f"column {name!r} stands {header.count(name)} times; keep one"
        elif name not in known:
            yield f"column {name!r} is not known; allowed are {needed}. Rename it or take it out"
    lights = [name for name in header if name in known and name.startswith("light_")]
    units = {name.rsplit("_", 1)[1] for name in lights}
    if len(units) > 1:
        yield f"columns {', '.join(lights)} have several units; use one"
    elif lights:
        missing = [name for name in (f"light_{axis}_{unit}" for unit in units for axis in "xyz") if name not in lights]
        if missing:
            yield f"{', '.join(missing)} is missing; a light needs x, y and z, or no column for one in the lens"


def _too_many_cells(separator: str, n_columns: int) -> str:
    what = f"has more cells than the header has columns ({n_columns})"
    if separator == ",":
        return f"{what}; a decimal comma? Use the decimal point, or semicolons between the cells"
    return what


def _distance_problems(positions: Path, placements: list[Placement], width_mm: float) -> Iterator[Problem]:
    for placement in placements:
        distance = float(np.linalg.norm(placement.camera))
        if distance < _CLOSEST * width_mm:
            what = (
                f"{placement.file}: the camera is {distance:.3g} mm from the centre of an area {width_mm:g} mm wide. "
                "In metres or centimetres? Name the columns camera_x_m ... or camera_x_cm ..., or correct the width"
            )
            yield Problem(f"{positions}:{placement.line}", what)


def _columns(header: list[str], device: str) -> tuple[list[str], float] | None:
    """Return the three columns of a device's position and their unit in mm."""
    for unit, millimetres in UNITS_MM.items():
        names = [f"{device}_{axis}_{unit}" for axis in "xyz"]
        if all(name in header for name in names):
            return names, millimetres
    return None


def _position(cells: dict[str, str], columns: tuple[list[str], float], *, decimal_comma: bool) -> Array:
    names, millimetres = columns
    texts = [cells[name].replace(",", ".") if decimal_comma else cells[name] for name in names]
    position = np.array([float(text) for text in texts]) * millimetres
    if not np.all(np.isfinite(position)) or position[2] <= 0.0:
        raise ValueError(f"position is {position.tolist()} mm")
    return position


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
    if is_raw(path):
        raise ValueError("a RAW file is a mosaic, which cannot be registered; develop it linearly and save it as TIFF")
    values = read_picture(path).pixels
    if values.ndim == 2:
        values = values[..., None]
    if min(values.shape[:2]) < MIN_SIDE:
        height, width = values.shape[:2]
        raise ValueError(f"has {width} x {height} pixels; needed are {MIN_SIDE} at least a side, or it has no slopes")
    whole = values.dtype.kind in "iu"
    scale = np.iinfo(values.dtype).max if whole else 1.0
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
