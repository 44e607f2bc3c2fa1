"""Generators of poses, to put a protocol together in Python; the tables of `protocol.toml` become the same."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

Pose = Mapping[str, float]


def ring(tilt: float, count: int, start: float = 0.0) -> Iterator[Pose]:
    """Yield `count` poses at one tilt, evenly round the turntable; turns wrap into 0 to 360 degrees.

    Parameters
    ----------
    tilt, start : float
        Position of axis ``"tilt"``, and of axis ``"turn"`` at the first pose, degrees.
    count : int
        How many.
    """
    for i in range(count):
        yield {"tilt": tilt, "turn": (start + 360.0 * i / count) % 360.0}


def repeated(poses: Iterable[Pose], repeats: int) -> Iterator[Pose]:
    """Yield all `poses` in their order, `repeats` times over."""
    kept = list(poses)
    for _ in range(repeats):
        yield from kept
