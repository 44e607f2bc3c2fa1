"""`halfangle reproduce`: runs the experiments, each in a process of its own, and goes on where an earlier run ended."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from analysis.stages import Track, untracked
from benchmarks.reproduction.run_experiment import RESULT
from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import write_whole

NAMES = (
    "identifiability",
    "images",
    "slices",
    "baseline",
    "spheres",
    "methods",
    "synthetic",
    "riviere",
    "real",
    "cameras",
    "traits",
)
"""In the order of the supplement."""

REQUEST = "request.json"

_ROOT = Path(__file__).parents[2]

_SOURCES = ("analysis", "benchmarks", "drivers", "instrument", "protocols")

Result = dict[str, Any]


def check_names(names: Sequence[str]) -> None:
    """Refuse names that no experiment has.

    Raises
    ------
    InvalidInputError
        With all of them, and those that there are.
    """
    problems = [Problem(name, f"is no experiment; there are {', '.join(NAMES)}") for name in names if name not in NAMES]
    if problems:
        raise InvalidInputError("Nothing was run.", problems)


def reproduce(
    names: Sequence[str],
    folder: Path,
    *,
    quick: bool,
    seed: int,
    merl: Path | None = None,
    announce: Callable[[str], None] = lambda _: None,
    track: Track = untracked,
) -> Iterator[Result]:
    """Run experiments and yield what became of each.

    One that was run before in the same way, by the same code and to its end is not run again.

    Parameters
    ----------
    names : sequence of str
        Of `NAMES`.
    folder : Path
        Each experiment has a folder of its own in it.
    quick, seed, merl
        As `benchmarks.reproduction.experiment.Request`.
    announce : callable
        Takes a line before each.
    track : Track
        Learns how many experiments are done.
    """
    request = {
        "quick": quick,
        "seed": seed,
        "merl": None if merl is None else str(merl.resolve()),
        "code": code_digest(),
    }
    for name in track(names):
        place = folder / name
        known = _earlier(place, request)
        announce(f"{name} (as it was run before)" if known else name)
        yield known or _run(name, place, request)


def code_digest() -> str:
    """Return a digest of the program's sources: with other code an experiment is another one."""
    digest = hashlib.sha256()
    for package in _SOURCES:
        for path in sorted((_ROOT / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _earlier(place: Path, request: Result) -> Result | None:
    try:
        result: Result = json.loads((place / RESULT).read_text(encoding="utf-8"))
        is_same = (result["request"], result["status"]) == (request, "ok")
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return result if is_same else None


def _run(name: str, place: Path, request: Result) -> Result:
    place.mkdir(parents=True, exist_ok=True)
    (place / RESULT).unlink(missing_ok=True)
    file = place / REQUEST
    write_whole(file, json.dumps(request, indent=2), overwrite=True)
    ended = subprocess.run(
        [sys.executable, "-m", "benchmarks.reproduction.run_experiment", name, str(file)], check=False
    )
    if (place / RESULT).exists():
        result: Result = json.loads((place / RESULT).read_text(encoding="utf-8"))
        return result
    why = f"its process ended with code {ended.returncode} and no result"
    return {"name": name, "status": "failed", "ours": "", "stated": "", "verdict": "", "why": why, "seconds": 0.0}
