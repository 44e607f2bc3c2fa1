"""Keep a run: python -m benchmarks.accuracy.keep DIR, where DIR is what `halfangle bench -o DIR` wrote."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from benchmarks.accuracy.compare import kept_result, read_report
from benchmarks.accuracy.page import page

DOCS = Path(__file__).parents[2] / "docs"


def keep(folder: Path, docs: Path = DOCS) -> None:
    """Copy result and picture of a run to where they are kept, and write the page of the documentation from them."""
    report = read_report(folder / "bench.json")
    shutil.copy(folder / "bench.json", kept_result(quick=report["quick"]))
    shutil.copy(folder / "bench.png", docs / "images" / "bench.png")
    (docs / "accuracy.md").write_text(page(report, "images/bench.png"), encoding="utf-8")


if __name__ == "__main__":
    keep(Path(sys.argv[1]))
