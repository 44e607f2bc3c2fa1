"""The files of a run of the benchmark: rows, picture and page."""

from __future__ import annotations

from pathlib import Path

from benchmarks.accuracy.compare import read_report
from benchmarks.accuracy.page import page
from benchmarks.accuracy.pareto import write_pareto
from benchmarks.accuracy.run import Report
from instrument.files.json_file import write_json
from instrument.files.whole_file import write_whole

FILES = ("bench.json", "bench.png", "accuracy.md")


def write_report(folder: Path, report: Report) -> None:
    """Write all of them into `folder`.

    Raises
    ------
    FileExistsError
        If one is there already.
    NotWrittenError
        If the disk or the folder does not take one.
    """
    write_json(folder / "bench.json", report, read=read_report)
    write_pareto(folder / "bench.png", report)
    write_whole(folder / "accuracy.md", page(report))
