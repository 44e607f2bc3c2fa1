"""A session of 65 poses x 4 exposures x 2.3 Mpixel to a registered stack of 1 Mpixel: seconds and peak memory.

Run as `python -m benchmarks.speed.registration FOLDER`. The session is captured on the simulated rig the first
time (some minutes, 1 GB) and kept in FOLDER; the command that is timed is `halfangle calibrate`, in a process
of its own.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from benchmarks.common.processes import program, timed
from benchmarks.common.simulated import EXAMPLES
from instrument.config.loading import load_protocol, load_rig
from protocols.capture.engine import capture

WIDTH, HEIGHT, FOCAL_LENGTH_PX = 1920, 1200, 3700.0

EXPOSURE_TIMES_S = (0.002, 0.006, 0.02, 0.06)

PITCH_MM = 0.06  # 1000 x 1000 pixels of the area of the example's rig

TARGET_S = 120.0


def session_in(folder: Path) -> Path:
    """Return the session of the benchmark, captured if it is not there."""
    path = folder / "speed.session.h5"
    if path.exists():
        return path
    rig = load_rig(EXAMPLES / "simulated.toml")
    camera = rig.camera.model_copy(
        update={"width": WIDTH, "height": HEIGHT, "focal_length_px": FOCAL_LENGTH_PX},
    )
    protocol = load_protocol(EXAMPLES / "hdr_sweep.toml")
    bracket = protocol.bracket.model_copy(update={"exposure_times_s": EXPOSURE_TIMES_S})
    part = folder / "speed.part.h5"
    part.unlink(missing_ok=True)
    capture(rig.model_copy(update={"camera": camera}), protocol.model_copy(update={"bracket": bracket}), part)
    part.rename(path)
    return path


def main() -> None:
    """Time it, and say so."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    session = session_in(folder)
    with TemporaryDirectory(dir=folder) as scratch:
        stack = Path(scratch) / "area.stack.h5"
        command = [*program("calibrate"), str(session), "-o", str(stack), "--pitch", str(PITCH_MM), "--quiet"]
        seconds, cpu_seconds, peak_mb = timed(command)
        size_mb = stack.stat().st_size / 1e6
    click.echo(f"session {session.stat().st_size / 1e6:.0f} MB -> stack {size_mb:.0f} MB")
    click.echo(f"{seconds:.0f} s ({cpu_seconds:.0f} CPU s), peak {peak_mb:.0f} MB; target {TARGET_S:.0f} s on 2 cores")


if __name__ == "__main__":
    main()
