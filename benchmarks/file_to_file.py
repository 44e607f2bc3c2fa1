"""The whole solve as a user runs it: a stack's file in, a result's file out, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from analysis.reflectance import Cosines
from analysis.result import read_result
from analysis.stack import write_stack
from benchmarks.methods import Estimate
from benchmarks.scenes import Scene

COMMAND = (sys.executable, "-c", "from cli.main import main; main()", "reconstruct", "--quiet")


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
        seconds, cpu_seconds, peak_mb = timed([*COMMAND, str(source), "-o", str(output)])
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
    """Run a command; return seconds, seconds of processor time and its peak memory, MB (the last two NaN on Windows).

    Raises
    ------
    RuntimeError
        If it does not exit with 0.
    """
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    if not hasattr(os, "wait4"):
        process.wait()
        cpu_seconds, peak_mb = float("nan"), float("nan")
    else:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        # Linux counts in KiB, macOS in bytes.
        peak_mb = usage.ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
        cpu_seconds = usage.ru_utime + usage.ru_stime
    if process.returncode != 0:
        raise RuntimeError(f"the command exited with {process.returncode}: {' '.join(command)}")
    return time.perf_counter() - begin, cpu_seconds, peak_mb
