"""Pictures of a folder become a session, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from operator import or_
from pathlib import Path

from instrument.config import load_settings
from instrument.pictures.arrangement import Arrangement, arrange, arrangement_problems, time_problems
from instrument.pictures.capture_config import RESPONSE_REMEDY, CaptureConfig, capture_misfits
from instrument.pictures.consistency import consistency_problems
from instrument.pictures.response import Curve, CurveError, given_curve
from instrument.pictures.selection import Complaint, select
from instrument.pictures.sensor import Sensor, sensor_of
from instrument.pictures.survey import Watcher, survey
from instrument.toml_lines import TomlLines
from instrument.validation import Problem, raise_if_any

CAPTURE_FILE = "capture.toml"


@dataclass(frozen=True)
class Import:
    """Pictures that have been looked at and are ready to be written.

    Attributes
    ----------
    config : CaptureConfig
    arrangement : Arrangement
    sensor : Sensor
    response : ndarray of float32, shape (1 or 3, L), or None
        A given curve.
    """

    config: CaptureConfig
    arrangement: Arrangement
    sensor: Sensor
    response: Curve | None


def load_capture(path: Path) -> CaptureConfig:
    """Read a `capture.toml`.

    Raises
    ------
    InvalidInputError
        With every problem found, each at ``file:line``.
    """
    return load_settings(CaptureConfig, path, capture_misfits)


def prepare_import(folder: Path, capture_file: Path, watch: Watcher = lambda done, total, name: None) -> Import:
    """Look at every picture that a `capture.toml` asks for; nothing is written.

    Parameters
    ----------
    folder : Path
        What the names of files are relative to.
    capture_file : Path
    watch : callable, optional
        Told how many of how many pictures have been looked at, and the name of the next.

    Raises
    ------
    InvalidInputError
        With everything that is wrong with the settings, or with the choice of files and the files themselves, or
        with how they fit each other.
    """
    config = load_capture(capture_file)
    title = f"{folder} cannot be imported"
    selection, complaints = select(config, folder)
    good, bad = survey(dict.fromkeys(pick.path for pick in selection.all()), watch)
    names = {pick.path: pick.name for pick in selection.all()}
    raise_if_any(
        title,
        [
            *_placed(complaints, config, capture_file),
            *(Problem(names[path], why) for path, why in bad.items()),
            *time_problems(selection, good),
        ],
    )
    arrangement = arrange(selection, good)
    problems = [*arrangement_problems(arrangement), *consistency_problems(arrangement)]
    problems += _linearity_problems(config, arrangement, capture_file)
    raise_if_any(title, problems)
    sensor = _sensor(config, arrangement, capture_file, title)
    return Import(config, arrangement, sensor, _curve(config, sensor, folder, capture_file, title))


def _placed(complaints: list[Complaint], config: CaptureConfig, capture_file: Path) -> Iterator[Problem]:
    lines = TomlLines(config.text)
    for line, what in sorted((lines.line(key), what) for key, what in complaints):
        yield Problem(f"{capture_file.name}:{line}", what)


def _linearity_problems(config: CaptureConfig, arrangement: Arrangement, capture_file: Path) -> Iterator[Problem]:
    lines = TomlLines(config.text)
    dtype = arrangement.frames[0].surveyed.dtype
    if dtype == "u1" and config.linear is None and config.response is None:
        what = f"pictures of 8 bits are made for display and not proportional to light; {RESPONSE_REMEDY}. "
        yield Problem(f"{capture_file.name}:1", f"{what}If they are proportional to light, set linear = true")
    if dtype == "f4" and config.response is not None:
        where = f"{capture_file.name}:{lines.line(('response',))}"
        yield Problem(
            where, "floating-point pictures must be linear; undo their curve before, and leave [response] out"
        )


def _sensor(config: CaptureConfig, arrangement: Arrangement, capture_file: Path, title: str) -> Sensor:
    beside = (*arrangement.ambient, *arrangement.flats, *arrangement.response, *arrangement.darks)
    all_bits = reduce(or_, (frame.surveyed.any_bits for frame in (*arrangement.frames, *beside)))
    try:
        return sensor_of(config.camera, arrangement.frames, all_bits)
    except ValueError as error:
        line = TomlLines(config.text).line(("camera",))
        raise_if_any(title, [Problem(f"{capture_file.name}:{line}", f"camera: {error}")])
        raise


def _curve(config: CaptureConfig, sensor: Sensor, folder: Path, capture_file: Path, title: str) -> Curve | None:
    if config.response is None:
        return None
    try:
        return given_curve(config.response, 2**sensor.camera.bit_depth, folder)
    except CurveError as error:
        line = TomlLines(config.text).line(("response", "curve"))
        raise_if_any(title, [Problem(f"{capture_file.name}:{line}", f"response.curve: {error}")])
        raise
