"""Writes a `capture.toml` to complete, filled in as far as the pictures of a folder tell."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from math import hypot
from pathlib import Path

from instrument.config.proposed_boards import PROPOSED_AREA_MM, proposed_boards
from instrument.config.toml_text import board_lines
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.imports.brackets import same_time, split_by_exposure
from instrument.imports.named_folders import BESIDE, VIEWS, NamedFolders, named_folders, unnamed_text
from instrument.imports.survey import Surveyed, look_at
from instrument.pictures.exif import Shot, read_shot
from instrument.pictures.picture import UnreadablePictureError
from instrument.pictures.reading import KNOWN_KINDS, VIDEO_REMEDY, VIDEO_SUFFIXES

# mm across the diagonal of a frame of 36 x 24 mm, which focal lengths "in 35 mm film" refer to.
DIAGONAL_35MM = 43.27


def capture_template(folder: Path) -> str:
    """Return the text of a `capture.toml` for the pictures in `folder`.

    Raises
    ------
    InvalidInputError
        If there are none, the first one cannot be read, or folders called views, darks and flats leave open what is
        meant.
    """
    return _template(folder, named_folders(folder), f"No capture.toml was written for {folder}")


def capture_by_names(folder: Path) -> str:
    """Return the same where folders called views, darks and flats say all that a `capture.toml` would.

    Raises
    ------
    InvalidInputError
        If they do not.
    """
    title = f"{folder} needs a capture.toml; `halfangle import --init {folder}` writes one to complete"
    folders = named_folders(folder)
    pictures = (*folders.views, *(path for paths in folders.beside.values() for path in paths))
    problems = [
        Problem(path.relative_to(folder).as_posix(), "does not say its exposure time")
        for path in pictures
        if read_shot(path).exposure_time is None
    ]
    if folders.unnamed:
        problems.append(Problem(str(folder), f"{unnamed_text(folders)}, and nothing says what they are"))
    raise_if_any(title, [*folders.problems, *problems])
    return _template(folder, folders, title)


def _template(folder: Path, folders: NamedFolders, title: str) -> str:
    raise_if_any(title, folders.problems)
    paths = folders.views
    if not paths:
        problems = [Problem(str(folder), f"holds no picture; known are {KNOWN_KINDS}"), *_video_problems(folder)]
        raise InvalidInputError(title, problems)
    try:
        first = look_at(paths[0])
    except UnreadablePictureError as error:
        raise InvalidInputError(title, [Problem(paths[0].name, str(error))]) from None
    shots = [read_shot(path) for path in paths]
    parts = (_head(folder, first), _light(first), _camera(first), _grouping(folder, paths, shots))
    tail = (TAIL, _boards(), _beside(folder, folders))
    return "\n".join(line for part in (*parts, *tail) for line in part) + "\n"


def _video_problems(folder: Path) -> Iterator[Problem]:
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in VIDEO_SUFFIXES and not path.name.startswith("."):
            yield Problem(path.name, VIDEO_REMEDY)


def _head(folder: Path, first: Surveyed) -> Iterator[str]:
    yield "# What the pictures in this folder do not say themselves. Lines that begin with # are off; docs/import.md"
    yield "# explains every key. Lengths are in mm, times in seconds."
    yield f"name = {json.dumps(folder.resolve().name or 'capture', ensure_ascii=False)}"
    yield 'sample = ""'
    yield _focal_length(first)
    yield "# working_distance_mm = 350.0"


def _focal_length(first: Surveyed) -> str:
    focal = first.shot.focal_length_35mm
    if focal is None:
        return "# focal_length_px = 3000.0  # a first guess of the focal length in pixels"
    pixels = focal / DIAGONAL_35MM * hypot(*first.shape[:2])
    return f"focal_length_px = {pixels:.0f}  # as the pictures say: like one of {focal:g} mm on 35 mm film"


def _light(first: Surveyed) -> Iterator[str]:
    if first.dtype != "u1" and not first.curve:
        yield "# linear = false  # if the counts are not proportional to light; then [response] is needed"
        return
    why = "have 8 bits and are made for display" if first.dtype == "u1" else f"state {first.curve}"
    yield ""
    yield f"# The pictures {why}. Say by which curve: take one of the three lines below;"
    yield "# or set linear = true and delete [response], if they are proportional to light."
    yield "linear = false"
    yield "[response]"
    yield '# gamma = "srgb"  # or a number such as 2.2'
    yield '# curve = "curve.csv"  # count, linear'
    yield '# bracket = { files = ["bracket/*.jpg"] }  # a still scene at several exposure times'


def _camera(first: Surveyed) -> Iterator[str]:
    yield ""
    yield "[camera]"
    yield f"# The pictures have {first.shape[1]} x {first.shape[0]} pixels."
    yield f"# make = {_said(first.shot.make or None, 'Acme')}"
    yield f"# model = {_said(first.shot.model or None, 'One')}"
    yield f"# bayer_pattern = {_said(first.bayer_pattern or None, 'RGGB')}"
    yield f"# black_level = {_said(_levels(first.black_level), 64)}"
    yield f"# saturation_level = {_said(first.saturation_level, 4095)}"
    yield "# conversion_gain = 2.0  # electrons per count"
    yield "# read_noise = 3.0  # electrons"


def _said(value: object, example: object) -> str:
    if value is None:
        return f"{json.dumps(example, ensure_ascii=False)}  # the pictures do not say"
    return f"{json.dumps(value, ensure_ascii=False)}  # as the pictures say"


def _levels(levels: tuple[float, ...] | None) -> float | list[float] | None:
    if levels is None:
        return None
    return levels[0] if len(set(levels)) == 1 else list(levels)


def _grouping(folder: Path, paths: Sequence[Path], shots: Sequence[Shot]) -> Iterator[str]:
    yield ""
    yield "[grouping]"
    yield f"glob = {_glob(folder, paths)}  # fits {len(paths)}"
    times = [shot.exposure_time for shot in shots if shot.exposure_time is not None]
    if len(times) < len(paths):
        yield f"exposure_times_s = [1.0]  # {len(paths) - len(times)} of them do not say it: state the true time"
        yield "# frames_per_pose = 1  # with an exposure time for each, if poses have brackets"
    elif all(same_time(time, times[0]) for time in times):
        yield f"# Every picture is a pose of its own, of {times[0]:g} s."
    else:
        sizes = split_by_exposure(times)
        yield 'by = "exposure"'
        yield f"# Poses: {len(sizes)}, of pictures each: {_range(sizes)}, of {min(times):g} to {max(times):g} s."
        yield "# frames_per_pose = 3  # instead of by, if that is wrong"


def _range(sizes: Sequence[int]) -> str:
    return str(sizes[0]) if len(set(sizes)) == 1 else f"{min(sizes)} to {max(sizes)}"


TAIL = """
# The area to reconstruct, centred on the origin of the sample frame (x right, y up).
# [area]
# width_mm = 60.0
# height_mm = 60.0
# pitch_mm = 0.1

# The light beside the lens, in the camera frame (x right, y down, z forward).
# [light]
# offset_mm = [12.0, 0.0, 0.0]
# offset_sigma_mm = 3.0""".splitlines()

BOARDS_WORD = """
# One table for each board in the pictures; corner_mm is its top left corner, or "measure". These four stand around
# an area of {0:g} x {1:g} mm; to print them: halfangle boards --area-mm {0:g} {1:g} -o boards.pdf"""


def _boards() -> Iterator[str]:
    yield from BOARDS_WORD.format(*PROPOSED_AREA_MM).splitlines()
    for board in proposed_boards(PROPOSED_AREA_MM):
        yield from (f"# {line}" for line in board_lines(board) if line)


def _beside(folder: Path, folders: NamedFolders) -> Iterator[str]:
    yield ""
    yield "# Pictures beside those of the poses."
    if folders.unnamed:
        yield f"# {unnamed_text(folders)}: name them here, if they are to be read."
    for name in BESIDE:
        off = "" if name in folders.beside else "# "
        paths = folders.beside.get(name, ())
        yield f"{off}[{name}]"
        yield f"{off}files = [{_glob(folder, paths)}]  # fits {len(paths)}" if paths else f'# files = ["{name}/*"]'
        if any(read_shot(path).exposure_time is None for path in paths):
            yield "exposure_times_s = [1.0]  # some of them do not say it: state the true time"
        if name == "flats":
            yield "# distance_mm = 350.0"
    yield "# [ambient]"
    yield '# files = ["ambient.dng"]'


def _glob(folder: Path, paths: Sequence[Path]) -> str:
    """Return the pattern that fits pictures of one kind, which lie in one folder or in folders of one."""
    parents = {path.parent for path in paths}
    parts = list(paths[0].parent.relative_to(folder).parts)
    if parts and (len(parents) > 1 or len(parts) > 1 or parts[0].lower() not in (VIEWS, *BESIDE)):
        parts[-1] = "*"
    return json.dumps("/".join([*parts, f"*{paths[0].suffix}"]), ensure_ascii=False)
