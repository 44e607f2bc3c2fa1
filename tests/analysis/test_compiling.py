"""Kernels work where there is no place for a cache of compiled code, and say so once."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

KERNELS = """
import numpy as np
from numba import prange

from analysis import compiling as ours
from drivers.simulated.rendering import compiling as theirs


@ours.njit(cache=True, nogil=True, fastmath={"contract"})
def norm(x):
    return np.sqrt(np.sum(x * x))


@ours.njit(cache=True, nogil=True, parallel=True)
def norms(x):
    found = np.empty(len(x))
    for i in prange(len(x)):
        found[i] = norm(x[i])
    return found


@theirs.njit(cache=True, nogil=True, error_model="numpy")
def inverse(x):
    return 1.0 / x


print(norms(np.random.default_rng(0).normal(size=(5, 7))).tobytes().hex(), inverse(0.0))
"""


def run(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the kernels, for a user whose home cannot be written."""
    (folder / "kernels.py").write_text(KERNELS)
    nowhere = {"HOME": "/proc/nohome", "XDG_CACHE_HOME": "/proc/nohome", "NUMBA_CACHE_DIR": "/proc/nohome"}
    environment = {**os.environ, **nowhere, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(folder / "kernels.py")],
        check=False, capture_output=True, text=True, env=environment, timeout=200,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done


def test_without_a_place_for_a_cache_the_bits_are_the_same_and_it_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "with").mkdir()
    (tmp_path / "without").mkdir()
    # A file where the folder would be made: nobody can write into it, not even root.
    (tmp_path / "without" / "__pycache__").write_text("")
    cached, anew = run(tmp_path / "with"), run(tmp_path / "without")
    assert list((tmp_path / "with" / "__pycache__").glob("*.nbi"))
    assert cached.stderr == ""
    assert anew.stdout == cached.stdout
    assert anew.stdout.endswith("inf\n")
    assert len(anew.stderr.splitlines()) == 1
    assert "NUMBA_CACHE_DIR" in anew.stderr


@pytest.mark.parametrize("package", ["analysis", "drivers"])
def test_every_kernel_is_compiled_in_that_way(package: str) -> None:
    # One that asks numba itself for a cache ends the program where there is no place.
    paths = [path for path in (ROOT / package).rglob("*.py") if path.name != "compiling.py"]
    assert paths
    for path in paths:
        lines = path.read_text().splitlines()
        assert not [line for line in lines if "numba" in line and "import" in line and "jit" in line], path
