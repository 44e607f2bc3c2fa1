"""Prints a run of the benchmark for the terminal."""

from __future__ import annotations

from typing import Any

from benchmarks.accuracy.compare import Comparison
from instrument.files.text_table import text_table


def rows_table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as text."""
    head = ("part / method", "case", "views", "noise", "mean", "median", "95 %", "> 5 deg", "pixels/s", "x ref")
    return text_table([head, *(_cells(row) for row in rows)])


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    case = ", ".join(text for text in (row["table"], row["variant"], row["method_variant"]) if text)
    errors = (f"{row[key]:.3f}" for key in ("mean_deg", "median_deg", "p95_deg"))
    return (
        f"{row['part']} / {row['method']}",
        case,
        str(row["n_views"]),
        f"{100 * row['noise']:.1f} %",
        *errors,
        f"{100 * row['share_above_5deg']:.1f} %",
        f"{row['pixels_per_s']:.0f}",
        f"{row['ratio_to_reference']:.1f}",
    )


def comparison_text(comparison: Comparison | None, name: str) -> str:
    """Return how many rows were compared with the result of that name, and what is to be said of them."""
    if comparison is None or comparison.n_rows == 0:
        return f"not compared: no row of {name} was run"
    head = f"{comparison.n_rows} rows compared with {name}: {len(comparison.regressions)} figures worse"
    return "\n".join([head, *(f"  {text}" for text in comparison.notes)])
