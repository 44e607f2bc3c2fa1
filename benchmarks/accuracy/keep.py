"""Keep a run: python -m benchmarks.accuracy.keep DIR, where DIR is what `halfangle bench -o DIR` wrote."""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.accuracy.compare import kept_result, read_report
from benchmarks.accuracy.page import page
from instrument.files.whole_file import write_whole

DOCS = Path(__file__).parents[2] / "docs"


def keep(folder: Path, docs: Path = DOCS) -> None:
    """Copy result and picture of a run to where they are kept, and write the page of the documentation from them."""
    report = read_report(folder / "bench.json")
    kept = {"bench.json": kept_result(quick=report["quick"]), "bench.png": docs / "images" / "bench.png"}
    for name, place in kept.items():
        write_whole(place, (folder / name).read_bytes(), overwrite=True)
    write_whole(docs / "accuracy.md", page(report, "images/bench.png"), overwrite=True)


if __name__ == "__main__":
    keep(Path(sys.argv[1]))
