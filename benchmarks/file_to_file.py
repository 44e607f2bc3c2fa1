"""The whole solve as a user runs it: a stack's file in, a result's file out, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from analysis.reflectance.models import Cosines
from analysis.registration.stack_file import write_stack
from analysis.results.result_file import read_result
from benchmarks.methods import Estimate
from benchmarks.scenes import Scene

_PROGRAM = """
import atexit
from analysis.stages import peak_memory_mb
from cli.main import main
atexit.register(lambda: print(peak_memory_mb()))
main()
"""


def program(command: str) -> list[str]:
    """Return what runs a command of `halfangle` in a process of its own that prints its peak memory last."""
    return [sys.executable, "-c", _PROGRAM, command]


def file_to_file(scene: Scene) -> Estimate:
    """Reconstruct by the command, its start and both files in the time, all that it keeps in memory in the peak.

    Raises
    ------
    RuntimeError
        If the command fails.
    """
    with TemporaryDirectory() as folder:
        source, output = Path(folder) / "area.stack.h5", Path(folder) / "area.result.h5"
        write_stack(source, scene.stack)
        seconds, cpu_seconds, peak_mb = timed([*program("reconstruct"), "--quiet", str(source), "-o", str(output)])
        result = read_result(output)
    notes: dict[str, Any] = {"radiance_mb": scene.stack.radiance.nbytes / 1e6, "peak_mb": peak_mb}
    return Estimate(
        normals=result.fits.normals,
        sigma=result.fits.normal_sigma,
        curve=lambda theta_h: result.fits.brdf(Cosines.on_slice(theta_h)),
        seconds=seconds,
        cpu_seconds=cpu_seconds,
        depth=result.depth,
        notes=notes,
    )


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
