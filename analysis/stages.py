"""Time and memory of each stage of a run."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

if sys.platform != "win32":
    import resource


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
    """

    announce: Callable[[str], None] | None = None
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
