"""The command as a user runs it, in a process of its own that is timed from outside."""

from __future__ import annotations

import os
import subprocess
import sys
import time

# The installed command, found by its name: the benchmarks know no module of the command line.
_PROGRAM = """
import atexit
from importlib.metadata import entry_points
from analysis.stages import peak_memory_mb
(command,) = entry_points(group="console_scripts", name="halfangle")
atexit.register(lambda: print(peak_memory_mb()))
command.load()()
"""


def program(command: str) -> list[str]:
    """Return what runs a command of `halfangle` in a process of its own that prints its peak memory last."""
    return [sys.executable, "-c", _PROGRAM, command]


def timed(command: list[str]) -> tuple[float, float, float]:
    """Run a command whose last line of output is its peak memory; return seconds, processor seconds and the peak, MB.

    Raises
    ------
    RuntimeError
        If it does not exit with 0.
    """
    begin, before = time.perf_counter(), os.times()
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    seconds, after = time.perf_counter() - begin, os.times()
    if done.returncode != 0:
        raise RuntimeError(f"the command exited with {done.returncode}: {' '.join(command)}")
    cpu_seconds = sum(after[2:4]) - sum(before[2:4])  # of children, in the user's name and the system's
    return seconds, cpu_seconds, float(done.stdout.split()[-1])
