"""Prints sessions for the terminal."""

from __future__ import annotations

from typing import Any

from instrument.files.validation import printable
from instrument.session_tools.examination import Examination


def verdict_text(found: Examination) -> str:
    """Return what an examination found, and what to do about it."""
    lines = [str(problem) for problem in found.problems]
    passed = "" if found.problems else "every check passed; "
    lines.append(f"{found.path}: {passed}{len(found.good)} of {found.n_poses} poses are good: {_ranges(found.good)}")
    if found.missing:
        lines.append(f"not captured: poses {_ranges(found.missing)}; halfangle resume goes on with them")
    if found.problems:
        lines.append("Reprocess the good poses only; keep the file as it is, and capture the others again.")
    return "\n".join(lines)


def _ranges(numbers: list[int]) -> str:
    """Return [0, 1, 2, 5] as "0-2, 5"."""
    starts = [n for n in numbers if n - 1 not in numbers]
    ends = [n for n in numbers if n + 1 not in numbers]
    return ", ".join(f"{a}-{b}" if a < b else str(a) for a, b in zip(starts, ends, strict=True)) or "none"


def listed_text(row: dict[str, Any]) -> str:
    """Return a line about one file of a list of sessions."""
    if "problems" in row:
        (where, what), *others = row["problems"]
        place = "" if where == row["path"] else f"{where}: "
        poses, text = "", place + what + (f" (and {len(others)} more)" if others else "")
    else:
        poses, text = f"{row['n_complete']:>5}/{row['n_poses']:<5}", row["title"]
    return f"{row['state']:<12} {poses:<11} {row['path']}  {text}"


def summary_text(summary: dict[str, Any]) -> str:
    """Return the summary of a session, a line for each value."""
    width = max(map(len, summary))
    return "\n".join(f"{name:<{width}}  {printable(_shown(value))}" for name, value in summary.items())


def _shown(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
