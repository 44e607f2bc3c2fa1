"""Arranges the pictures of an import by pose and exposure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from instrument.files.validation import Problem
from instrument.imports.brackets import exposure_indices, nominal_times, same_time, split_by_exposure
from instrument.imports.finder import Pick
from instrument.imports.selection import Selection
from instrument.imports.survey import Surveyed
from instrument.pictures.reading import is_raw
from instrument.session.import_plan import ImportPlan, Source
from instrument.session.layout import MAX_SIZES

_TYPES = {"u1": "8 bits", "u2": "16 bits", "f4": "floating point"}


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture with its exposure time in seconds."""

    pick: Pick
    surveyed: Surveyed
    exposure_time: float

    @property
    def source(self) -> Source:
        """The picture as the plan names it."""
        return Source(self.pick.name, self.surveyed.sha256, self.exposure_time)


Property = Callable[[Frame], object]


@dataclass(frozen=True)
class Arrangement:
    """All pictures in their places.

    Attributes
    ----------
    exposure_times : tuple of float, length E
        Nominal, seconds, ascending.
    poses : tuple of tuple of Frame, length P
        From short to long.
    ambient : tuple of Frame, length A
    ambient_of_pose : tuple of int, length P
        Index into `ambient`, -1 = none.
    darks, flats, response : tuple of Frame
    flat_distances : tuple of float
        mm, NaN = not stated.
    """

    exposure_times: tuple[float, ...]
    poses: tuple[tuple[Frame, ...], ...]
    ambient: tuple[Frame, ...]
    ambient_of_pose: tuple[int, ...]
    darks: tuple[Frame, ...]
    flats: tuple[Frame, ...]
    flat_distances: tuple[float, ...]
    response: tuple[Frame, ...]

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Every picture of a pose."""
        return tuple(frame for pose in self.poses for frame in pose)

    def indices(self, i_pose: int) -> list[int]:
        """Return which exposures the frames of a pose are."""
        return exposure_indices([frame.exposure_time for frame in self.poses[i_pose]], self.exposure_times)

    def darks_of(self, i_exposure: int) -> list[Frame]:
        """Return the dark frames of one exposure."""
        indices = exposure_indices([dark.exposure_time for dark in self.darks], self.exposure_times)
        return [dark for dark, index in zip(self.darks, indices, strict=True) if index == i_exposure]

    @property
    def plan(self) -> ImportPlan:
        """The plan of the session."""
        return ImportPlan(
            exposure_times=self.exposure_times,
            poses=tuple(tuple(frame.source for frame in pose) for pose in self.poses),
            darks=_sources(self.darks),
            flats=_sources(self.flats),
            ambient=_sources(self.ambient),
            response=_sources(self.response),
        )


def time_problems(selection: Selection, surveyed: Mapping[Path, Surveyed]) -> Iterator[Problem]:
    """Yield the pictures whose exposure time nobody states."""
    for pick in dict.fromkeys(selection.all()):
        if pick.path in surveyed and _time(pick, surveyed) is None:
            what = f"does not say its exposure time; state it as exposure_times_s{_place(pick)} in capture.toml"
            yield Problem(pick.name, what)


def arrange(selection: Selection, surveyed: Mapping[Path, Surveyed]) -> Arrangement:
    """Put pictures in their places; all of them are good and have an exposure time."""

    def frames(picks: Sequence[Pick]) -> tuple[Frame, ...]:
        return tuple(Frame(pick, surveyed[pick.path], _time(pick, surveyed) or 0.0) for pick in picks)

    poses = [frames(pose) for pose in selection.poses]
    if selection.by_exposure:
        poses = _split(poses[0])
    times = nominal_times([[frame.exposure_time for frame in pose] for pose in poses])
    wanted = [pick or selection.ambient for pick in selection.pose_ambient or (None,) * len(poses)]
    ambient = list(dict.fromkeys(pick for pick in wanted if pick is not None))
    return Arrangement(
        exposure_times=times,
        poses=tuple(tuple(sorted(pose, key=lambda frame: frame.exposure_time)) for pose in poses),
        ambient=frames(ambient),
        ambient_of_pose=tuple(-1 if pick is None else ambient.index(pick) for pick in wanted),
        darks=frames(selection.darks),
        flats=frames(selection.flats),
        flat_distances=selection.flat_distances,
        response=frames(selection.response),
    )


def arrangement_problems(arrangement: Arrangement) -> Iterator[Problem]:
    """Yield exposure times that do not fit each other."""
    if len(arrangement.exposure_times) > MAX_SIZES["E"]:
        what = f"there are {len(arrangement.exposure_times)} of all pictures together; allowed are {MAX_SIZES['E']}"
        yield Problem("exposure times", what)
    for i_pose, pose in enumerate(arrangement.poses):
        yield from _repeated_times(i_pose, pose, arrangement.indices(i_pose))
    for dark in arrangement.darks:
        if not any(same_time(dark.exposure_time, time) for time in arrangement.exposure_times):
            what = f"is a dark frame of {dark.exposure_time:g} s; no picture of a pose has that exposure time"
            yield Problem(dark.pick.name, what)
    without = [f"{t:g} s" for e, t in enumerate(arrangement.exposure_times) if not arrangement.darks_of(e)]
    if arrangement.darks and without:
        what = f"no dark frame of {', '.join(without)}; take them, or leave [darks] out"
        yield Problem("darks", what)
    if len({frame.exposure_time for frame in arrangement.response}) == 1:
        yield Problem("response.bracket", "all pictures have one exposure time; a curve needs several")


def _repeated_times(i_pose: int, pose: Sequence[Frame], indices: Sequence[int]) -> Iterator[Problem]:
    first: dict[int, Frame] = {}
    for frame, index in zip(pose, indices, strict=True):
        if index in first:
            yield Problem(
                frame.pick.name,
                f"has the exposure time {frame.exposure_time:g} s of {first[index].pick.name} in the same pose "
                f"({i_pose}); a bracket has each time once, so is one of them another pose?",
            )
        first.setdefault(index, frame)


def _split(frames: Sequence[Frame]) -> list[tuple[Frame, ...]]:
    sizes = split_by_exposure([frame.exposure_time for frame in frames])
    ends = [sum(sizes[: i + 1]) for i in range(len(sizes))]
    return [tuple(frames[end - size : end]) for size, end in zip(sizes, ends, strict=True)]


def _time(pick: Pick, surveyed: Mapping[Path, Surveyed]) -> float | None:
    return pick.stated_time or surveyed[pick.path].shot.exposure_time


def _place(pick: Pick) -> str:
    table = pick.key[0]
    return f" of poses[{pick.key[1]}]" if table == "poses" else f" in [{table}]"


def _sources(frames: Sequence[Frame]) -> tuple[Source, ...]:
    return tuple(frame.source for frame in frames)


def consistency_problems(arrangement: Arrangement) -> Iterator[Problem]:
    """Yield the pictures that differ from the others in what must be the same."""
    frames, darks = arrangement.frames, arrangement.darks
    shot_alike = _unique([*frames, *arrangement.ambient, *arrangement.flats])
    everything = _unique([*shot_alike, *darks, *arrangement.response])
    yield from _odd(everything, "size", lambda f: _size(f.surveyed.shape), frames)
    # A mean of dark frames may come as floating-point numbers.
    counts = [f for f in everything if not (f in darks and f.surveyed.dtype == "f4")]
    yield from _odd(counts, "type of values", lambda f: _TYPES[f.surveyed.dtype], frames)
    yield from _odd(everything, "mosaic", lambda f: f.surveyed.bayer_pattern or None, frames)
    yield from _odd(shot_alike, "stated curve", lambda f: f.surveyed.curve or "none", frames)
    yield from _odd([*shot_alike, *darks], "ISO", lambda f: f.surveyed.shot.iso, frames)
    yield from _odd(shot_alike, "f-number", lambda f: f.surveyed.shot.f_number, frames)
    if not is_raw(frames[0].pick.path):
        # Only pictures that are no RAW files have one applied.
        yield from _odd(shot_alike, "white balance", lambda f: f.surveyed.shot.white_balance or None, frames)


def _size(shape: Sequence[int]) -> str:
    channels = f" with {shape[2]} channels" if len(shape) == 3 else ""
    return f"{shape[1]} x {shape[0]} pixels{channels}"


def _unique(frames: Sequence[Frame]) -> list[Frame]:
    return list({frame.pick.path: frame for frame in frames}.values())


def _odd(frames: Sequence[Frame], what: str, value: Property, most: Sequence[Frame]) -> Iterator[Problem]:
    """Yield the frames whose value is not that of most pictures of the poses; None is not known and fits all."""
    known = [value(frame) for frame in most if value(frame) is not None]
    if not known:
        return
    usual = Counter(known).most_common(1)[0][0]
    for frame in frames:
        found = value(frame)
        if found is not None and found != usual:
            text = f"its {what} is {_shown(found)} and that of other pictures {_shown(usual)}; all must be alike"
            yield Problem(frame.pick.name, text)


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
