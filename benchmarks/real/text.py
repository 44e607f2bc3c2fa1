"""Prints the real cases for the terminal, and keeps them."""

from __future__ import annotations

from pathlib import Path

from benchmarks.common.origin import origin
from benchmarks.real.run import Row
from instrument.files.json_file import write_json
from instrument.files.text_table import text_table

KEPT = Path(__file__).parents[1] / "results" / "real.json"


def rows_table(rows: list[Row]) -> str:
    """Return the rows as text."""
    head = (
        "case", "method", "materials", "left out", "worst", "free gain", "light, mm", "± mm", "off, mm", "lean, deg",
        "mean, deg", "median", "68 %", "95 %", "s",
    )  # fmt: skip
    return text_table([head, *(_cells(row) for row in rows)])


def keep(rows: list[Row], seed: int, path: Path = KEPT) -> None:
    """Write the rows to a file, over those of an earlier run."""
    write_json(path, {"seed": seed} | origin() | {"rows": [row.as_dict() for row in rows]}, overwrite=True)


def _cells(row: Row) -> tuple[str, ...]:
    return (
        row.case,
        row.method,
        row.materials,
        *(_percent(value) for value in (row.left_out, row.left_out_worst, row.left_out_gain)),
        *(_pair(value) for value in (row.light_mm, row.light_sigma_mm)),
        _number(row.light_off_mm, 1),
        _number(row.lean_deg, 2),
        _number(row.error_mean_deg, 2),
        _number(row.error_median_deg, 2),
        *(_percent(value) for value in (row.coverage68, row.coverage95)),
        f"{row.seconds:.0f}",
    )


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.0f} %"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _pair(value: tuple[float, float] | None) -> str:
    return "" if value is None else f"{value[0]:.1f}, {value[1]:.1f}"
