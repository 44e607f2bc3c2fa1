"""From the tables of a `capture.toml` to the files that they name."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from instrument.config_problems import dotted
from instrument.pictures.capture_config import CaptureConfig, FlatsTable, GroupingTable
from instrument.pictures.reading import is_picture
from instrument.toml_lines import KeyPath

Complaint = tuple[KeyPath, str]


@dataclass(frozen=True, slots=True)
class Pick:
    """A picture that is asked for.

    Attributes
    ----------
    path : Path
    name : str
        Its path within the folder, with slashes.
    key : tuple
        Which key of the `capture.toml` asks for it.
    stated_time : float or None
        Exposure time in seconds, if that is stated there.
    """

    path: Path
    name: str
    key: KeyPath
    stated_time: float | None = None


@dataclass(frozen=True)
class Selection:
    """All pictures that are asked for.

    Attributes
    ----------
    poses : tuple of tuple of Pick
        The bracket of each pose; all pictures in one where exposure times tell the poses apart.
    by_exposure : bool
        Whether they do.
    pose_ambient : tuple of (Pick or None)
        Of each of the `poses`.
    ambient : Pick or None
        For all other poses.
    darks, flats, response : tuple of Pick
    flat_distances : tuple of float
        mm, NaN = not stated.
    """

    poses: tuple[tuple[Pick, ...], ...]
    by_exposure: bool
    pose_ambient: tuple[Pick | None, ...]
    ambient: Pick | None
    darks: tuple[Pick, ...]
    flats: tuple[Pick, ...]
    flat_distances: tuple[float, ...]
    response: tuple[Pick, ...]

    def all(self) -> Iterator[Pick]:
        """Yield every picture, those of the poses first."""
        for pose in self.poses:
            yield from pose
        yield from (pick for pick in (*self.pose_ambient, self.ambient) if pick is not None)
        yield from (*self.darks, *self.flats, *self.response)


def select(config: CaptureConfig, folder: Path) -> tuple[Selection, list[Complaint]]:
    """Return the pictures that `config` asks for and that are there, and what is wrong with the rest."""
    finder = _Finder(folder)
    beside = {
        "darks": finder.table(config.darks, "darks"),
        "flats": finder.table(config.flats, "flats"),
        "response": _response(config, finder),
    }
    ambient = finder.table(config.ambient, "ambient")
    pose_ambient = [finder.find(pose.ambient, None, ("poses", i, "ambient")) for i, pose in enumerate(config.poses)]
    taken = {pick.path for picks in (*beside.values(), ambient, *pose_ambient) for pick in picks}
    grouping = config.grouping or GroupingTable()
    poses = _stated_poses(config, finder) if config.poses else _grouped_poses(grouping, finder, taken)
    distances = _distances(config.flats, beside["flats"], finder)
    selection = Selection(
        poses=poses,
        by_exposure=not config.poses and grouping.by == "exposure",
        pose_ambient=tuple(picks[0] if picks else None for picks in pose_ambient),
        ambient=ambient[0] if ambient else None,
        flat_distances=distances,
        **beside,
    )
    return selection, [*finder.complaints, *_repeated(poses)]


def natural_order(name: str) -> list[tuple[int, str]]:
    """Sort key that puts ``IMG_9`` before ``IMG_10``."""
    return [(int(part), "") if part.isdigit() else (-1, part.lower()) for part in re.split(r"(\d+)", name)]


class _Finder:
    """Finds pictures in a folder and keeps what was wrong."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.complaints: list[Complaint] = []

    def complain(self, key: KeyPath, what: str) -> None:
        self.complaints.append((key, f"{dotted(key)}: {what}"))

    def table(self, table: object, key: str) -> tuple[Pick, ...]:
        """Return the pictures of a table that has `files` and `exposure_times_s`."""
        if table is None:
            return ()
        return self.find(table.files, table.exposure_times_s, (key, "files"))  # type: ignore[attr-defined]

    def find(self, files: Sequence[str], times: Sequence[float] | None, key: KeyPath) -> tuple[Pick, ...]:
        found = [(path, (*key, i)) for i, name in enumerate(files) for path in self._expanded(name, (*key, i))]
        if times is not None and len(times) not in (1, len(found)):
            self.complain(key, f"there are {len(found)} pictures and {len(times)} exposure times; give one for each")
            times = None
        each = [None] * len(found) if times is None else list(times) * (len(found) if len(times) == 1 else 1)
        return tuple(Pick(path, self._name(path), where, time) for (path, where), time in zip(found, each, strict=True))

    def glob(self, pattern: str) -> list[Path]:
        """Return the pictures that fit `pattern`, in the order of their names."""
        found = (path for path in self.folder.glob(pattern) if path.is_file() and is_picture(path))
        return sorted(found, key=lambda path: natural_order(self._name(path)))

    def _expanded(self, name: str, key: KeyPath) -> list[Path]:
        if re.search(r"[*?\[]", name):
            found = self._fitting(name, key)
        else:
            found = [self.folder / name] if (self.folder / name).is_file() else []
        if not found:
            self.complain(key, f"{name!r} is not in {self.folder}{self._hint(name)}")
        return found

    def _fitting(self, pattern: str, key: KeyPath) -> list[Path]:
        try:
            return self.glob(pattern)
        except (NotImplementedError, ValueError) as error:
            self.complain(key, f"{pattern!r} cannot be used: {error}")
            return []

    def _hint(self, name: str) -> str:
        close = get_close_matches(name, [self._name(path) for path in self.folder.rglob("*") if path.is_file()], n=1)
        return f"; did you mean {close[0]!r}?" if close else ""

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()


def _response(config: CaptureConfig, finder: _Finder) -> tuple[Pick, ...]:
    bracket = config.response.bracket if config.response else None
    key = ("response", "bracket", "files")
    return () if bracket is None else finder.find(bracket.files, bracket.times_s, key)


def _stated_poses(config: CaptureConfig, finder: _Finder) -> tuple[tuple[Pick, ...], ...]:
    return tuple(
        finder.find(pose.files, pose.exposure_times_s, ("poses", i, "files")) for i, pose in enumerate(config.poses)
    )


def _grouped_poses(grouping: GroupingTable, finder: _Finder, taken: set[Path]) -> tuple[tuple[Pick, ...], ...]:
    paths = [path for path in finder._fitting(grouping.glob, ("grouping", "glob")) if path not in taken]
    size = len(paths) if grouping.by == "exposure" else grouping.frames_per_pose or 1
    if not paths:
        finder.complain(("grouping", "glob"), f"no picture in {finder.folder} fits {grouping.glob!r}")
        return ()
    if len(paths) % size:
        what = f"there are {len(paths)} pictures, which are no whole poses of {size}; is one missing?"
        finder.complain(("grouping", "frames_per_pose"), what)
    times = grouping.exposure_times_s or (None,) * size
    picks = [Pick(path, finder._name(path), ("grouping",), times[i % size]) for i, path in enumerate(paths)]
    return tuple(tuple(picks[i : i + size]) for i in range(0, len(picks), size))


def _distances(table: FlatsTable | None, flats: Sequence[Pick], finder: _Finder) -> tuple[float, ...]:
    if table is None or table.distance_mm is None:
        return (float("nan"),) * len(flats)
    if len(table.distance_mm) == 1:
        return table.distance_mm * len(flats)
    if len(table.distance_mm) != len(flats):
        what = f"there are {len(table.distance_mm)} distances for {len(flats)} pictures; give one for each"
        finder.complain(("flats", "distance_mm"), what)
    return table.distance_mm


def _repeated(poses: Sequence[Sequence[Pick]]) -> Iterator[Complaint]:
    first: dict[Path, Pick] = {}
    for pick in (pick for pose in poses for pick in pose):
        if pick.path in first:
            yield pick.key, f"{dotted(pick.key)}: {pick.name} stands at {dotted(first[pick.path].key)} already"
        first.setdefault(pick.path, pick)
