"""One experiment in a process of its own: python -m benchmarks.reproduction.run_experiment NAME REQUEST.json.

What it leaves in its folder is `result.json`, written at the end in one piece, and `table.csv`.
"""

from __future__ import annotations

import csv
import io
import json
import sys
import time
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from analysis.stages import peak_memory_mb
from benchmarks.reproduction.experiment import Experiment, Finding, Request, Row, SkippedError
from instrument.files.whole_file import write_whole

RESULT, TABLE, ERROR = "result.json", "table.csv", "error.txt"


def load(name: str) -> Experiment:
    """Return the experiment of a name; see `benchmarks.reproduction.reproduce.NAMES`."""
    experiment: Experiment = import_module(f"benchmarks.reproduction.experiments.{name}").EXPERIMENT
    return experiment


def run(experiment: Experiment, request: Request) -> dict[str, Any]:
    """Return what becomes of an experiment: its finding, why it was skipped, or how it failed."""
    began = time.perf_counter()
    result: dict[str, Any] = {"name": experiment.name, "stated": experiment.stated}
    try:
        result |= _found(experiment.run(request), request.folder)
    except SkippedError as error:
        result |= {"status": "skipped", "ours": "", "verdict": "", "why": str(error)}
    # Whatever an experiment trips over, the others are run all the same.
    except Exception as error:
        write_whole(request.folder / ERROR, traceback.format_exc(), overwrite=True)
        result |= {"status": "failed", "ours": "", "verdict": "", "why": f"{type(error).__name__}: {error}"}
    return result | {"seconds": round(time.perf_counter() - began, 1), "peak_mb": round(peak_memory_mb())}


def _found(finding: Finding, folder: Path) -> dict[str, Any]:
    _write_table(folder / TABLE, finding.rows)
    return {
        "status": "ok",
        "ours": finding.ours,
        "verdict": finding.verdict.value,
        "why": finding.why,
        "figures": [path.name for path in finding.figures],
        "rows": list(finding.rows),
    }


def _write_table(path: Path, rows: Sequence[Row]) -> None:
    if not rows:
        return
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue(), overwrite=True)


def main(name: str, request_file: Path) -> None:
    """Run the experiment `name` as the file says."""
    said = json.loads(request_file.read_text(encoding="utf-8"))
    merl = None if said["merl"] is None else Path(said["merl"])
    request = Request(request_file.parent, said["quick"], said["seed"], merl)
    result = run(load(name), request) | {"request": said}
    text = json.dumps(result, indent=2, default=_plain) + "\n"
    write_whole(request.folder / RESULT, text, overwrite=True)


def _plain(value: Any) -> Any:
    """Return a number of numpy as one of Python's."""
    return value.item()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
