"""Where camera and light stood for each picture: a table with a header, or the light directions of a dome."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from instrument.files.validation import Problem

Array = NDArray[np.float64]

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}

FAR_MM = 1e6
"""Distance of camera and lights of which only the direction is known: nothing of the near field is left."""


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
    power : float
        Of the light, relative.
    """

    file: str
    camera: Array
    light: Array
    line: int
    power: float = 1.0


def read_positions(path: Path) -> tuple[list[Placement], list[Problem]]:
    """Read the table of positions; return its rows and all that is wrong with it."""
    if path.suffix.lower() == ".lp":
        return _read_light_directions(path)
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


def _read_light_directions(path: Path) -> tuple[list[Placement], list[Problem]]:
    """Read an ``.lp`` file of reflectance transformation imaging: how many pictures, then each with a light direction.

    The camera of such a dome looks straight down from far away, as the program that wrote the file has it.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        return [], [Problem(str(path), f"cannot be read ({error})")]
    rows = [(number, line.strip()) for number, line in enumerate(lines, start=1) if line.strip()]
    if not rows or not rows[0][1].isdigit():
        return [], [Problem(f"{path}:1", "must be the number of pictures; after it, a line each: file x y z")]
    placements, problems = [], []
    for number, line in rows[1:]:
        name, *cells = line.rsplit(maxsplit=3)
        try:
            direction = np.array([float(cell) for cell in cells])
        except ValueError:
            direction = np.array([])
        length = float(np.linalg.norm(direction)) if direction.shape == (3,) else 0.0
        if not (np.isfinite(length) and length > 0.0 and direction[2] > 0.0):
            what = f"is {line!r}; needed are a file and a direction x y z to the light, z above the sample"
            problems.append(Problem(f"{path}:{number}", what))
            continue
        light = FAR_MM * direction / length
        # Whoever wrote it had the pictures in a folder of his own; Windows' names split at either slash.
        file = PureWindowsPath(name).name
        placements.append(Placement(file, np.array([0.0, 0.0, FAR_MM]), light, number, FAR_MM**2))
    if int(rows[0][1]) != len(rows) - 1:
        problems.append(Problem(f"{path}:1", f"says {rows[0][1]} pictures; {len(rows) - 1} lines follow"))
    return placements, problems


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
