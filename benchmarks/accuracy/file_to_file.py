"""The whole solve as a user runs it: a stack's file in, a result's file out, in a process of its own."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from analysis.reflectance.models import Cosines
from analysis.registration.stack_file import write_stack
from analysis.results.result_file import read_result
from benchmarks.common.methods import Estimate
from benchmarks.common.processes import program, timed
from benchmarks.common.scenes import Scene


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
