"""Pictures that are already registered to the sample plane, and a table of where camera and light stood."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from analysis.registration.lighting import looking_at_centre
from analysis.registration.stack import Stack
from instrument.files.validation import Problem, raise_if_any

Array = NDArray[np.float64]

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}

LINEAR_SUFFIXES = (".exr", ".npy")

_CLIPPED_8_BIT = 254.5 / 255.0

_RELATIVE_NOISE = 0.005  # shot noise of a consumer sensor in a bright pixel; the solver finds the rest


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
        optionally ``light_x_mm`` ...; without a light it is where the camera is.
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
    placements, problems = read_positions(positions)
    raise_if_any(title, problems)
    raise_if_any(title, _picture_problems(folder, positions, placements, gamma))
    pictures = [_read_picture(folder / p.file) for p in placements]
    raise_if_any(title, _size_problems(positions, placements, pictures, binning))
    linear, variance, clipped = zip(*(_linearise(picture, gamma or 1.0, binning) for picture in pictures), strict=True)
    camera = np.stack([p.camera for p in placements])
    return Stack(
        radiance=np.stack(linear),
        variance=np.stack(variance),
        saturated=np.stack(clipped),
        camera_position=camera,
        light_position=np.stack([p.light for p in placements]),
        light_power=np.ones(len(placements)),
        pixel_pitch=width_mm / pictures[0].shape[1] * binning,
        camera_rotation=looking_at_centre(camera),
    )


def read_positions(path: Path) -> tuple[list[Placement], list[Problem]]:
    """Read the table of positions; return its rows and all that is wrong with it."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        return [], [Problem(str(path), f"cannot be read ({error})")]
    reader = csv.DictReader(lines)
    header = [name.strip() for name in reader.fieldnames or []]
    camera, light = _columns(header, "camera"), _columns(header, "light")
    if "file" not in header or camera is None:
        wanted = "file, camera_x_mm, camera_y_mm, camera_z_mm (or _cm, _m), and optionally light_x_mm ..."
        return [], [Problem(f"{path}:1", f"columns are {', '.join(header) or 'none'}; needed are {wanted}")]
    placements: list[Placement] = []
    problems: list[Problem] = []
    for number, row in enumerate(reader, start=2):
        cells = {
            (key or "").strip(): (value or "").strip() for key, value in row.items() if not isinstance(value, list)
        }
        try:
            at_camera = _position(cells, camera)
            at_light = _position(cells, light) if light else at_camera
        except ValueError as error:
            problems.append(
                Problem(f"{path}:{number}", f"{error}; positions must be finite numbers with z above the sample")
            )
            continue
        placements.append(Placement(cells["file"], at_camera, at_light, number))
    if not placements and not problems:
        problems.append(Problem(str(path), "names no picture"))
    return placements, problems


def _columns(header: list[str], device: str) -> tuple[list[str], float] | None:
    """Return the three columns of a device's position and their unit in mm."""
    for unit, millimetres in UNITS_MM.items():
        names = [f"{device}_{axis}_{unit}" for axis in "xyz"]
        if all(name in header for name in names):
            return names, millimetres
    return None


def _position(cells: dict[str, str], columns: tuple[list[str], float]) -> Array:
    names, millimetres = columns
    position = np.array([float(cells[name]) for name in names]) * millimetres
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
    positions: Path, placements: list[Placement], pictures: list[NDArray[np.float32]], binning: int
) -> Iterator[Problem]:
    first = pictures[0].shape
    for placement, picture in zip(placements, pictures, strict=True):
        if picture.shape != first:
            text = f"{placement.file} has {picture.shape}; the first picture has {first}, and all must be alike"
            yield Problem(f"{positions}:{placement.line}", text)
    if min(first[:2]) < binning:
        yield Problem("--bin", f"is {binning}; pictures have {first[1]} x {first[0]} pixels")


def _read_picture(path: Path) -> NDArray[np.float32]:
    """Return (height, width, 1 or 3) in R, G, B; integers scaled so that the largest is 1."""
    suffix = path.suffix.lower()
    if suffix == ".npy":
        values = np.load(path, allow_pickle=False)
    elif suffix == ".exr":
        values = _read_exr(path)
    else:
        values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED | cv2.IMREAD_ANYDEPTH)
        if values is None:
            raise ValueError("not a picture, or damaged")
        if values.ndim == 3:
            values = values[..., 2::-1]
    if values.ndim == 2:
        values = values[..., None]
    if values.ndim != 3 or values.shape[2] not in (1, 3):
        raise ValueError(f"has shape {values.shape}; must be (height, width) with 1 or 3 channels")
    scale = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1.0
    return np.ascontiguousarray(values, np.float32) / np.float32(scale)


def _read_exr(path: Path) -> NDArray[np.float32]:
    with OpenEXR.File(str(path)) as file:
        channels = file.channels()
        name = next((n for n in ("RGB", "RGBA", "Y") if n in channels), None)
        if name is None:
            raise ValueError(f"channels are {sorted(channels)}; needed are R, G, B or Y")
        return np.asarray(channels[name].pixels[..., :3] if name != "Y" else channels[name].pixels, np.float32)


def _linearise(
    picture: NDArray[np.float32], gamma: float, binning: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    """Undo the display curve; return radiance, variance (quantisation and shot noise) and what is clipped."""
    clipped = picture >= _CLIPPED_8_BIT
    linear = np.maximum(picture, 0.0) ** gamma
    # One step of 8 bits, seen through the slope of the curve.
    step = gamma * np.maximum(picture, 1.0 / 255.0) ** (gamma - 1.0) / 255.0
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
