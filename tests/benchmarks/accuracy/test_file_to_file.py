"""The whole solve by the command, measured from outside."""

import sys

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from benchmarks.accuracy.file_to_file import file_to_file, timed
from benchmarks.common.scenes import relief


def test_what_the_command_writes_is_read_back_and_measured() -> None:
    scene = relief(16, 25, 0.02, 3)
    estimate = file_to_file(scene)
    assert np.median(angular_error_deg(estimate.normals, scene.normals)) < 1.0
    assert estimate.depth is not None
    assert estimate.depth.shape == (16, 16)
    assert estimate.cpu_seconds > 0.0
    assert 50.0 < estimate.notes["peak_mb"] < 4096.0
    assert estimate.curve(np.full((256, 2), 0.3)).shape == (256, 2, 3)


def test_a_command_that_fails_is_no_measurement() -> None:
    with pytest.raises(RuntimeError, match="exited with 3"):
        timed([sys.executable, "-c", "import sys; sys.exit(3)"])


def test_the_peak_is_that_of_the_command_and_not_of_whoever_runs_it() -> None:
    ballast = np.ones(60_000_000)
    program = "from analysis.stages import peak_memory_mb; print(peak_memory_mb())"
    assert timed([sys.executable, "-c", program])[2] < 300.0 < ballast.nbytes / 1e6
