"""Stages of a run: which one is under way, how far it is, and what time and memory each took."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeVar

if sys.platform != "win32":
    import resource


Item = TypeVar("Item")


class Track(Protocol):
    """Passes items on one by one, and tells somebody how many are done."""

    def __call__(self, items: Sequence[Item], /) -> Iterable[Item]:
        """Return the items, in their order."""


def untracked(items: Sequence[Item]) -> Iterable[Item]:
    """Pass items on, and tell nobody."""
    return items


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage: its name, wall-clock seconds, and the process's peak memory by its end, MB."""

    name: str
    seconds: float
    peak_mb: float


@dataclass
class Stages:
    """Collects stages as they run; several runs of one name add up.

    Attributes
    ----------
    announce : callable or None
        Called with the name of each stage as it begins.
    progress : callable or None
        Called with how many of the parts of the stage under way are done, and how many there are in all.
    """

    announce: Callable[[str], None] | None = None
    progress: Callable[[int, int], None] | None = None
    _stages: dict[str, Stage] = field(default_factory=dict)

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Measure what runs inside."""
        if self.announce is not None:
            self.announce(name)
        begin = time.perf_counter()
        try:
            yield
        finally:
            seconds = time.perf_counter() - begin
            before = self._stages[name].seconds if name in self._stages else 0.0
            self._stages[name] = Stage(name, before + seconds, peak_memory_mb())

    def track(self, items: Sequence[Item]) -> Iterator[Item]:
        """Pass on the parts of the stage under way one by one, and tell how many are done."""
        for done, item in enumerate(items):
            self._tell(done, len(items))
            yield item
        self._tell(len(items), len(items))

    def _tell(self, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(done, total)

    def __iter__(self) -> Iterator[Stage]:
        return iter(self._stages.values())


def peak_memory_mb() -> float:
    """Return the largest resident memory that this process has had, MB; NaN where the system does not tell."""
    status = Path("/proc/self/status")
    if status.is_file():
        # Not getrusage: on Linux its peak goes on from that of the program which started this one.
        for line in status.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 2**10
    if sys.platform == "win32":
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Linux counts in KiB, macOS in bytes.
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10
