"""Selects the files that the tables of a `capture.toml` name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from instrument.config.capture_config import CaptureConfig, FlatsTable, GroupingTable
from instrument.config.messages import dotted
from instrument.imports.finder import Complaint, Finder, Pick
from instrument.imports.named_folders import BESIDE, called_otherwise
from instrument.pictures.reading import KNOWN_KINDS


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
    finder = Finder(folder)
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


def _response(config: CaptureConfig, finder: Finder) -> tuple[Pick, ...]:
    bracket = config.response.bracket if config.response else None
    key = ("response", "bracket", "files")
    return () if bracket is None else finder.find(bracket.files, bracket.times_s, key)


def _stated_poses(config: CaptureConfig, finder: Finder) -> tuple[tuple[Pick, ...], ...]:
    return tuple(
        finder.find(pose.files, pose.exposure_times_s, ("poses", i, "files")) for i, pose in enumerate(config.poses)
    )


def _grouped_poses(grouping: GroupingTable, finder: Finder, taken: set[Path]) -> tuple[tuple[Pick, ...], ...]:
    paths = [path for path in finder.fitting(grouping.glob, ("grouping", "glob")) if path not in taken]
    size = len(paths) if grouping.by == "exposure" else grouping.frames_per_pose or 1
    if not paths:
        what = f"no picture in {finder.folder} fits {grouping.glob!r}; known are {KNOWN_KINDS}"
        finder.complain(("grouping", "glob"), what)
        return ()
    _complain_of_darks_among_views(paths, grouping.glob, finder)
    if len(paths) % size:
        what = f"there are {len(paths)} pictures, which are no whole poses of {size}; is one missing?"
        finder.complain(("grouping", "frames_per_pose"), what)
    times = grouping.exposure_times_s or (None,) * size
    picks = [Pick(path, finder.name(path), ("grouping",), times[i % size]) for i, path in enumerate(paths)]
    return tuple(tuple(picks[i : i + size]) for i in range(0, len(picks), size))


def _complain_of_darks_among_views(paths: Sequence[Path], glob: str, finder: Finder) -> None:
    folders = Counter(called_otherwise(finder.name(path), glob) for path in paths)
    for name in BESIDE:
        if folders[name]:
            what = (
                f"{glob!r} takes {folders[name]} of the folder {name} for views; name them in [{name}], "
                f"or state a glob that leaves them out"
            )
            finder.complain(("grouping", "glob"), what)


def _distances(table: FlatsTable | None, flats: Sequence[Pick], finder: Finder) -> tuple[float, ...]:
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
