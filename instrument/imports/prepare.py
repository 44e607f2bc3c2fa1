"""Prepares the import of a folder of pictures; nothing is written yet."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from operator import or_
from pathlib import Path

from instrument.config.capture_config import RESPONSE_REMEDY, CaptureConfig, capture_misfits, load_capture
from instrument.config.loading import settings_from_text
from instrument.config.messages import dotted
from instrument.config.toml_lines import KeyPath, TomlLines
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.imports.arrangement import (
    Arrangement,
    arrange,
    arrangement_problems,
    consistency_problems,
    time_problems,
)
from instrument.imports.named_folders import has_views
from instrument.imports.response_curve import Curve, given_curve
from instrument.imports.selection import select
from instrument.imports.sensor import Sensor, sensor_of
from instrument.imports.survey import Watcher, survey
from instrument.imports.template import capture_by_names

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


def prepare_import(
    folder: Path, capture_file: Path | None = None, watch: Watcher = lambda done, total, name: None
) -> Import:
    """Look at every picture that a `capture.toml` asks for; nothing is written.

    Parameters
    ----------
    folder : Path
        What the names of files are relative to.
    capture_file : Path, optional
        By default that of the folder; where it has none, its folders called views, darks and flats say what is what.
    watch : callable, optional
        Told how many of how many pictures have been looked at, and the name of the next.

    Raises
    ------
    InvalidInputError
        With everything that is wrong with the settings, or with the choice of files and the files themselves, or
        with how they fit each other.
    """
    config, name = _capture(folder, capture_file)
    title = f"{folder} cannot be imported"
    place = _Place(name, TomlLines(config.text))
    arrangement = _arranged(config, folder, place, title, watch)
    raise_if_any(
        title,
        [
            *arrangement_problems(arrangement),
            *consistency_problems(arrangement),
            *_linearity_problems(config, arrangement, place),
        ],
    )
    with _blaming(place, ("camera",), title):
        sensor = _sensor(config, arrangement)
    with _blaming(place, ("response", "curve"), title):
        curve = None if config.response is None else given_curve(config.response, 2**sensor.camera.bit_depth, folder)
    return Import(config, arrangement, sensor, curve)


def _capture(folder: Path, capture_file: Path | None) -> tuple[CaptureConfig, str]:
    """Return what is stated, and how messages call the place where it stands."""
    path = capture_file or folder / CAPTURE_FILE
    if path.exists():
        return load_capture(path), path.name
    if capture_file is None and has_views(folder):
        name = f"{CAPTURE_FILE} as --init would write it"
        text = capture_by_names(folder)
        return settings_from_text(CaptureConfig, text, folder / name, capture_misfits), name
    what = f"there is no such file; `halfangle import --init {folder}` writes one to complete"
    raise InvalidInputError(f"{folder} cannot be imported", [Problem(str(path), what)])


@dataclass(frozen=True, slots=True)
class _Place:
    """Where the keys of a `capture.toml` stand."""

    name: str
    lines: TomlLines

    def of(self, key: KeyPath) -> str:
        return f"{self.name}:{self.lines.line(key)}"


@contextmanager
def _blaming(place: _Place, key: KeyPath, title: str) -> Iterator[None]:
    """Turn a ValueError into a problem at `key`."""
    try:
        yield
    except ValueError as error:
        raise InvalidInputError(title, [Problem(place.of(key), f"{dotted(key)}: {error}")]) from None


def _arranged(config: CaptureConfig, folder: Path, place: _Place, title: str, watch: Watcher) -> Arrangement:
    """Find the pictures, look at all of them, and put them in their places."""
    selection, complaints = select(config, folder)
    names = {pick.path: pick.name for pick in selection.all()}
    good, bad = survey(names, watch)
    problems = [Problem(place.of(key), what) for key, what in sorted(complaints, key=lambda c: place.lines.line(c[0]))]
    problems += [Problem(names[path], why) for path, why in bad.items()]
    raise_if_any(title, [*problems, *time_problems(selection, good)])
    return arrange(selection, good)


def _linearity_problems(config: CaptureConfig, arrangement: Arrangement, place: _Place) -> Iterator[Problem]:
    dtype = arrangement.frames[0].surveyed.dtype
    is_told = config.linear is not None or config.response is not None
    if dtype == "u1" and not is_told:
        what = f"pictures of 8 bits are made for display and not proportional to light; {RESPONSE_REMEDY}"
        yield Problem(place.of(()), f"{what}. If they are proportional to light, set linear = true")
    lit = (*arrangement.frames, *arrangement.ambient, *arrangement.flats)
    curved = [frame for frame in lit if frame.surveyed.curve]
    if dtype != "u1" and curved and not is_told:
        remedy = "undo it" if dtype == "f4" else RESPONSE_REMEDY
        what = f"states {curved[0].surveyed.curve}, so that its values are not proportional to light; {remedy}"
        yield Problem(curved[0].pick.name, f"{what}. If they are proportional to light, set linear = true")
    if dtype == "f4" and config.response is not None:
        what = "floating-point pictures must be linear; undo their curve and leave [response] out"
        yield Problem(place.of(("response",)), what)


def _sensor(config: CaptureConfig, arrangement: Arrangement) -> Sensor:
    beside = (*arrangement.ambient, *arrangement.flats, *arrangement.response, *arrangement.darks)
    all_bits = reduce(or_, (frame.surveyed.any_bits for frame in (*arrangement.frames, *beside)))
    return sensor_of(config.camera, arrangement.frames, all_bits)


def import_facts(prepared: Import) -> list[tuple[str, str]]:
    """Return what an import will bring in, by name, for the operator."""
    arrangement, sensor = prepared.arrangement, prepared.sensor
    camera = sensor.camera
    boards = [f"{board.kind} {board.squares[0]} x {board.squares[1]}" for board in prepared.config.boards]
    beside = {name: len(getattr(arrangement, name)) for name in ("darks", "flats", "ambient", "response")}
    return [
        ("camera", f"{camera.make} {camera.model}".strip() or "not stated"),
        ("frames", f"{camera.width} x {camera.height}, {camera.bit_depth} bits, {_kind(prepared)}"),
        ("poses", f"{len(arrangement.poses)}, {len(arrangement.frames)} frames{_lengths(arrangement)}"),
        ("exposure times", ", ".join(f"{time:g}" for time in arrangement.exposure_times) + " s"),
        ("black level", ", ".join(f"{level:g}" for level in dict.fromkeys(sensor.black_level))),
        ("saturation level", f"{camera.saturation_value:g}"),
        ("boards", ", ".join(boards) or "none"),
        ("beside", ", ".join(f"{count} {name}" for name, count in beside.items() if count) or "nothing"),
    ]


def _kind(prepared: Import) -> str:
    camera = prepared.sensor.camera
    colours = camera.bayer_pattern or ("red, green, blue" if camera.n_channels == 3 else "monochrome")
    return f"{colours}, not linear" if prepared.config.response else colours


def _lengths(arrangement: Arrangement) -> str:
    """Return a word on brackets of different lengths, which may have been split wrongly."""
    lengths = {len(pose) for pose in arrangement.poses}
    if len(lengths) < 2:
        return ""
    return (
        f"; brackets of {min(lengths)} to {max(lengths)} pictures: if that is wrong, state [grouping] frames_per_pose"
    )
