"""Protocols in Python: a file with the tables of `protocol.toml` as values, and a generator of poses.

The file is run when somebody names it on the command line; what it yields is frozen into the plan. A session keeps its
text and never runs it.
"""

from __future__ import annotations

import runpy
import traceback
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from instrument.config.loading import load_protocol
from instrument.config.messages import complaints, validate
from instrument.config.protocol import ProtocolConfig
from instrument.files.validation import InvalidInputError, Problem
from instrument.session.layout import MAX_SIZES

MAX_POSES = MAX_SIZES["P"]
"""As many as a session can hold."""

TABLES = ("name", "sample", "bracket", "flats", "watch")
"""What a file may state besides its poses, each as the key of that name in `protocol.toml`."""


def load_any_protocol(path: Path) -> ProtocolConfig:
    """Read a protocol: Python if the name ends with .py, else TOML.

    Raises
    ------
    InvalidInputError
        With every problem found, each with its line where there is one.
    """
    return load_python_protocol(path) if path.suffix == ".py" else load_protocol(path)


def load_python_protocol(path: Path) -> ProtocolConfig:
    """Run a file that states `name`, `bracket` ... and a function `poses()` that yields a mapping for each pose.

    Raises
    ------
    InvalidInputError
        If the file fails, lacks something, or what it states is no protocol.
    """
    text = _text(path)
    values = _run(path)
    missing = [key for key in ("name", "bracket", "poses") if key not in values]
    if missing:
        raise _unusable(path, [Problem(path.name, f"states no {key}; see examples/spiral.py") for key in missing])
    data = {key: _plain(values[key]) for key in TABLES if key in values}
    data["poses"] = [{"axes": _plain(pose)} for pose in _poses(path, values["poses"])]
    try:
        protocol = validate(ProtocolConfig, data)
    except ValidationError as error:
        problems = [Problem(path.name, what) for _, what in complaints(ProtocolConfig, error)]
        raise _unusable(path, problems) from None
    protocol.remember(text)
    return protocol


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise _unusable(path, [Problem(str(path), f"cannot be read: {error}")]) from None


def _run(path: Path) -> dict[str, Any]:
    try:
        return runpy.run_path(str(path))
    except (Exception, SystemExit) as error:
        raise _unusable(path, [_failure(path, error)]) from error


def _poses(path: Path, generator: Any) -> list[Mapping[str, float]]:
    try:
        poses: list[Mapping[str, float]] = [dict(pose) for pose in islice(generator(), MAX_POSES + 1)]
    except (Exception, SystemExit) as error:
        raise _unusable(path, [_failure(path, error)]) from error
    if len(poses) > MAX_POSES:
        what = f"poses() yields more than {MAX_POSES} poses, and may never end; let it end"
        raise _unusable(path, [Problem(path.name, what)])
    return poses


def _plain(value: Any) -> Any:
    """Return plain numbers, lists and dictionaries for those of NumPy, at any depth."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_plain(inner) for inner in value] if isinstance(value, list | tuple) else value


def _failure(path: Path, error: BaseException) -> Problem:
    """Return where in the file an error arose, as far as the traceback tells."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    line = getattr(error, "lineno", None) if isinstance(error, SyntaxError) else (lines[-1] if lines else None)
    where = f"{path.name}:{line}" if line else path.name
    if isinstance(error, SystemExit):
        return Problem(
            where, "ends the program (sys.exit or the like); a protocol only states its poses. Take that out"
        )
    return Problem(where, f"{type(error).__name__}: {error}")


def _unusable(path: Path, problems: list[Problem]) -> InvalidInputError:
    return InvalidInputError(f"{path} cannot be used", problems)
