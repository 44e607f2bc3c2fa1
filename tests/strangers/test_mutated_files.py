"""Thousands of damaged and hostile files: each ends in a message, a flagged part, or nothing, and never in a crash."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.strangers.trial import FAILED

ROOT = Path(__file__).parents[2]
KINDS = ("session", "stack", "result", "dictionary")


def campaign(folder: Path, first: int, count: int, *sources: Path) -> dict[str, int]:
    """Try `count` seeds of each source in a process of its own; fail with the seeds of what went wrong."""
    command = [sys.executable, "-m", "tests.strangers.trial", folder, first, count, *sources]
    # A fork of a program with threads would wait for them.
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, cwd=ROOT, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr[-3000:]
    said = json.loads(done.stdout)
    numbers: dict[str, int] = said["numbers"]
    words = [f"{kind}, seed {seed} ({how}): {text}" for kind, seed, how, text in said["failures"]]
    assert not numbers.get(FAILED), "\n".join(words)
    assert sum(numbers.values()) == count * len(sources)
    return numbers


def test_mutated_files_are_fine_or_refused_or_contained(sources: dict[str, Path], tmp_path: Path) -> None:
    numbers = campaign(tmp_path, 0, 8, *sources.values())
    # The mutations do something, and not everything that they do is fatal.
    assert numbers["refused"] > 5
    assert numbers["fine"] > 5


@pytest.mark.slow
def test_thousands_of_mutated_files_end_no_reader(sources: dict[str, Path], tmp_path: Path) -> None:
    jobs = []
    with ThreadPoolExecutor(2) as pool:
        for kind in KINDS:
            for half in range(2):
                folder = tmp_path / f"{kind}{half}"
                folder.mkdir()
                jobs.append(pool.submit(campaign, folder, 10_000 + half * 250, 250, sources[kind]))
        numbers = [job.result() for job in jobs]
    assert sum(found.get("contained", 0) for found in numbers) > 0, "no mutation was dangerous: see mutations.py"
