"""The curve of pictures that are not linear, as given: linear value of each count."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from instrument.config.capture_config import ResponseConfig
from instrument.pictures.srgb import linear_from_srgb

Curve = NDArray[np.float32]


class CurveError(ValueError):
    """A file holds no curve."""


def given_curve(response: ResponseConfig, n_counts: int, folder: Path) -> Curve | None:
    """Return the curve, shape (1 or 3, n_counts), 1 at the largest count; None if it is to be estimated.

    Raises
    ------
    CurveError
        If the file of the curve cannot be used; the text begins with its name.
    """
    if response.curve is not None:
        return read_curve(folder / response.curve, n_counts)
    if response.gamma is None:
        return None
    v = np.linspace(0.0, 1.0, n_counts)
    linear = linear_from_srgb(v) if response.gamma == "srgb" else v ** float(response.gamma)
    return np.asarray(linear[None], np.float32)


def read_curve(path: Path, n_counts: int) -> Curve:
    """Read a CSV with a header: ``count`` and ``linear``, or ``count``, ``red``, ``green`` and ``blue``.

    Between its lines the curve is straight; the largest count becomes 1.

    Raises
    ------
    CurveError
    """
    header, rows = _read_rows(path)
    if header not in (["count", "linear"], ["count", "red", "green", "blue"]):
        wanted = "count, linear; or count, red, green, blue"
        raise CurveError(f"{path.name}:1 has the columns {', '.join(header) or 'none'}; needed are {wanted}")
    if len(rows) < 2 or rows[0, 0] > 0 or rows[-1, 0] < n_counts - 1 or (np.diff(rows[:, 0]) <= 0).any():
        raise CurveError(f"{path.name} must have ascending counts from 0 to {n_counts - 1}")
    curve = np.stack([np.interp(np.arange(n_counts), rows[:, 0], column) for column in rows[:, 1:].T])
    if (np.diff(curve, axis=1) < 0).any() or (curve[:, -1] <= 0).any():
        raise CurveError(f"{path.name} falls somewhere; more light never gives a smaller linear value")
    return np.asarray(curve / curve[:, -1:], np.float32)


def _read_rows(path: Path) -> tuple[list[str], NDArray[np.float64]]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        separator = ";" if lines and ";" in lines[0] else ","
        header, *rows = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=separator) if row]
        if separator == ";":
            # Tables with semicolons may have decimal commas.
            rows = [[cell.replace(",", ".") for cell in row] for row in rows]
        values = np.array([[float(cell) for cell in row] for row in rows], np.float64)
    except OSError as error:
        raise CurveError(f"{path.name} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise CurveError(f"{path.name} is no table of numbers: {error}") from None
    if values.ndim != 2 or values.shape[1] != len(header) or not np.isfinite(values).all():
        raise CurveError(f"{path.name} is no table of finite numbers with a header")
    return header, values
