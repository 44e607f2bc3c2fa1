"""Does a result say what a report shows? It may come from elsewhere, or from an earlier version."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from analysis.result import Result
from instrument.validation import Problem

Kind = type | tuple[type, ...] | dict[str, Any] | list[Any]

NUMBER = (int, float)
QUANTILES = {"mean": NUMBER, "median": NUMBER, "p95": NUMBER}

# What stands in a list is the kind of each of its elements.
_CHOICES: Kind = [{"effect": str, "chosen": str, "reason": str}]
_STAGES: Kind = [{"name": str, "seconds": NUMBER, "peak_mb": NUMBER}]
_SUMMARY: dict[str, Kind] = {
    "n_views": NUMBER,
    "n_pixels": NUMBER,
    "n_unsolved": NUMBER,
    "relative_error": NUMBER,
    "normal_sigma_deg": {"median": NUMBER, "p95": NUMBER},
    "theta_h_range_deg": [NUMBER],
}
_OPTIONAL: dict[str, Kind] = {
    "normal_error_deg": QUANTILES,
    "depth_shape": {"tilt_x": NUMBER, "tilt_y": NUMBER, "sag": NUMBER},
    "coverage68": NUMBER,
    "calibration": {},
    "left_out": [
        {
            "view": NUMBER, "relative_rms": NUMBER, "lambert_relative_rms": NUMBER, "psnr_db": NUMBER,
            "lambert_psnr_db": NUMBER, "glossy_gain_db": NUMBER, "n_glossy": NUMBER, "n_pixels": NUMBER,
        }
    ],
}  # fmt: skip
# Where the first is there, the second is shown too.
_WITH = {"normal_error_deg": "depth_rmse_without_plane_mm", "coverage68": "coverage95"}


def report_problems(result: Result) -> Iterator[Problem]:
    """Yield what a report needs and the result does not have."""
    summary = result.summary if isinstance(result.summary, dict) else {}
    wanted = _SUMMARY | {name: kind for name, kind in _OPTIONAL.items() if name in summary}
    wanted |= {other: NUMBER for name, other in _WITH.items() if name in summary}
    wanted |= {"depth_rmse_mm": NUMBER} if "normal_error_deg" in summary else {}
    yield from _misfits("/entry/choices", result.choices, _CHOICES)
    yield from _misfits("/entry/stages", result.stages, _STAGES)
    yield from _misfits("/entry/summary", result.summary, wanted)
    if len(summary.get("theta_h_range_deg", ())) != 2:
        yield Problem("/entry/summary.theta_h_range_deg", "must be two angles")


def _misfits(where: str, value: Any, kind: Kind) -> Iterator[Problem]:
    """Yield where JSON values are not of a kind; keys that are not asked for are no matter."""
    if isinstance(kind, dict):
        if not isinstance(value, dict):
            yield Problem(where, f"is {_shown(value)}; must be values by name")
            return
        for name, inner in kind.items():
            if name not in value:
                yield Problem(f"{where}.{name}", "is missing")
            else:
                yield from _misfits(f"{where}.{name}", value[name], inner)
    elif isinstance(kind, list):
        if not isinstance(value, list):
            yield Problem(where, f"is {_shown(value)}; must be a list")
            return
        for i, element in enumerate(value):
            yield from _misfits(f"{where}[{i}]", element, kind[0])
    elif not isinstance(value, kind):
        yield Problem(where, f"is {_shown(value)}; must be a {'text' if kind is str else 'number'}")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
