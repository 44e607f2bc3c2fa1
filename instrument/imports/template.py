"""Writes a `capture.toml` to complete, filled in as far as the pictures of a folder tell."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from math import hypot
from pathlib import Path

from instrument.files.validation import InvalidInputError, Problem
from instrument.imports.brackets import same_time, split_by_exposure
from instrument.imports.finder import natural_order
from instrument.imports.survey import Surveyed, look_at
from instrument.pictures.exif import Shot, read_shot
from instrument.pictures.picture import UnreadablePictureError
from instrument.pictures.reading import KNOWN_KINDS, READERS, VIDEO_REMEDY, VIDEO_SUFFIXES, is_picture, is_raw

# mm across the diagonal of a frame of 36 x 24 mm, which focal lengths "in 35 mm film" refer to.
DIAGONAL_35MM = 43.27


def capture_template(folder: Path) -> str:
    """Return the text of a `capture.toml` for the pictures in `folder`.

    Raises
    ------
    InvalidInputError
        If there are none, or the first one cannot be read.
    """
    paths = _pictures(folder)
    title = f"No capture.toml was written for {folder}"
    if not paths:
        problems = [Problem(str(folder), f"holds no picture; known are {KNOWN_KINDS}"), *_video_problems(folder)]
        raise InvalidInputError(title, problems)
    try:
        first = look_at(paths[0])
    except UnreadablePictureError as error:
        raise InvalidInputError(title, [Problem(paths[0].name, str(error))]) from None
    shots = [read_shot(path) for path in paths]
    parts = (_head(folder, first), _light(first), _camera(first), _grouping(folder, paths, shots), TAIL)
    return "\n".join(line for part in parts for line in part) + "\n"


def _pictures(folder: Path) -> list[Path]:
    """Return the pictures of the kind that is closest to the sensor; those in its folders if it has none itself."""
    kinds: dict[str, list[Path]] = defaultdict(list)
    for pattern in ("*", "*/*"):
        for path in folder.glob(pattern) if not kinds else ():
            if path.is_file() and is_picture(path):
                kinds[path.suffix].append(path)
    best = min(kinds, key=lambda suffix: (_rank(suffix), -len(kinds[suffix])), default="")
    return sorted(kinds[best], key=lambda path: natural_order(path.relative_to(folder).as_posix())) if best else []


def _video_problems(folder: Path) -> Iterator[Problem]:
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in VIDEO_SUFFIXES and not path.name.startswith("."):
            yield Problem(path.name, VIDEO_REMEDY)


def _rank(suffix: str) -> int:
    return -1 if is_raw(Path(f"x{suffix}")) else list(READERS).index(suffix.lower())


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
    folders = "" if paths[0].parent == folder else "*/"
    yield f"glob = {json.dumps(f'{folders}*{paths[0].suffix}', ensure_ascii=False)}  # fits {len(paths)}"
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
# offset_sigma_mm = 3.0

# One table for each board in the pictures; corner_mm is its top left corner, or "measure".
# [[boards]]
# kind = "charuco"
# dictionary = "DICT_4X4_50"
# first_id = 0
# squares = [4, 4]
# square_mm = 5.5
# marker_mm = 4.4
# corner_mm = [-54.0, 54.0]

# Pictures beside those of the poses.
# [darks]
# files = ["darks/*"]
# [flats]
# files = ["flats/*"]
# distance_mm = 350.0
# [ambient]
# files = ["ambient.dng"]""".splitlines()
