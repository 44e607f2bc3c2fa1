"""Pictures of one capture must be alike in all but light and exposure time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from instrument.pictures.arrangement import Arrangement, Frame
from instrument.validation import Problem

Property = Callable[[Frame], object]


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
    yield from _odd([*shot_alike, *darks], "ISO", lambda f: f.surveyed.shot.iso, frames)
    yield from _odd(shot_alike, "f-number", lambda f: f.surveyed.shot.f_number, frames)
    if frames[0].surveyed.saturation_level is None:
        # Only pictures that are no RAW files have one applied.
        yield from _odd(shot_alike, "white balance", lambda f: f.surveyed.shot.white_balance or None, frames)


_TYPES = {"u1": "8 bits", "u2": "16 bits", "f4": "floating point"}


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
