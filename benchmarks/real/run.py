"""Reconstructs every real case with the default options and without a palette, and says what came of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.evaluation.metrics import angular_error_deg
from analysis.evaluation.scoring import score
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from analysis.results.result import Result, result_of
from analysis.results.trust import failures
from benchmarks.real.cases import Capture, captures
from benchmarks.real.pictures import draw

Array = NDArray[np.float64]

METHODS = {"default": Options(), "palette off": Options(palette="off")}

MUST = {"card": (0.35, 0.45), "yellow box": (0.22, np.inf)}
"""Relative RMS of views left out that must be reached: median and worst."""

DOME_MUST_DEG, LIGHT_MUST_MM, WORSE_MUST = 4.1, 5.0, 1.05

_MANY_VIEWS, _N_LEFT_OUT = 15, 6

COVERAGE_68, COVERAGE_95 = 1.5096, 2.4477  # sigmas of two Gaussian components


@dataclass(frozen=True)
class Row:
    """One case and one method; None where it does not apply.

    Attributes
    ----------
    case, method : str
    materials : str
        What the choice of a palette came to.
    left_out, left_out_worst, left_out_gain : float or None
        Relative RMS of views left out: median, worst, median after one free gain.
    light_mm, light_sigma_mm : tuple of 2 float, or None
        Where it was found.
    light_off_mm : float or None
        From where others found it.
    lean_deg : float
        Of the mean normal from z.
    error_mean_deg, error_median_deg, coverage68, coverage95 : float or None
        Against the truth.
    told : tuple of str
        Why the result says that it is not to be trusted.
    seconds : float
    """

    case: str
    method: str
    materials: str
    left_out: float | None
    left_out_worst: float | None
    left_out_gain: float | None
    light_mm: tuple[float, float] | None
    light_sigma_mm: tuple[float, float] | None
    light_off_mm: float | None
    lean_deg: float
    error_mean_deg: float | None
    error_median_deg: float | None
    coverage68: float | None
    coverage95: float | None
    told: tuple[str, ...]
    seconds: float

    def as_dict(self) -> dict[str, object]:
        """Return it for JSON."""
        return asdict(self)


def run(seed: int, announce: Callable[[str], None], folder: Path | None = None) -> Iterator[Row]:
    """Yield a row for each case and method.

    Parameters
    ----------
    seed : int
        Of the measured materials drawn, and their reliefs.
    announce : callable
        Told what is under way.
    folder : Path or None
        Where a picture of each case goes.
    """
    for capture in captures(seed):
        for method, options in METHODS.items():
            announce(f"{capture.name}, {method}")
            begin = time.perf_counter()
            n_left_out = capture.stack.n_views if capture.stack.n_views < _MANY_VIEWS else _N_LEFT_OUT
            found = reconstruct(capture.stack, options)
            result = result_of(found, (), score(found, n_left_out), None)
            yield _row(capture, method, result, time.perf_counter() - begin)
            if folder is not None:
                draw(found, folder / f"{capture.name} {method}.png".replace(",", "").replace(" ", "-"))


def _row(capture: Capture, method: str, result: Result, seconds: float) -> Row:
    s = result.summary
    errors = [view.relative_rms for view in s.left_out]
    gains = [view.relative_rms_with_gain for view in s.left_out if view.relative_rms_with_gain is not None]
    found = None if s.light_offset_mm is None else s.light_offset_mm[:2]
    off = None
    if found is not None and capture.torch_mm is not None:
        off = float(np.hypot(*np.subtract(found, capture.torch_mm)))
    mean = np.nanmean(result.fits.normals, axis=0)
    lean = float(np.rad2deg(np.arccos(mean[2] / np.linalg.norm(mean))))
    return Row(
        case=capture.name,
        method=method,
        materials=next(choice.chosen for choice in result.choices if choice.effect == "palette"),
        left_out=float(np.median(errors)) if errors else None,
        left_out_worst=max(errors) if errors else None,
        left_out_gain=float(np.median(gains)) if gains else None,
        light_mm=found,
        light_sigma_mm=None if s.light_offset_sigma_mm is None else s.light_offset_sigma_mm[:2],
        light_off_mm=off,
        lean_deg=lean,
        **_truth_figures(capture.normals, result),
        told=tuple(text.partition(":")[0] for text in failures(s)),
        seconds=seconds,
    )


def _truth_figures(normals: Array | None, result: Result) -> dict[str, float | None]:
    names = ("error_mean_deg", "error_median_deg", "coverage68", "coverage95")
    if normals is None:
        return dict.fromkeys(names)
    error = angular_error_deg(result.fits.normals, normals)
    known = np.isfinite(error)
    ratio = error[known] / np.rad2deg(result.fits.normal_sigma[known])
    inside = (float(np.mean(ratio < limit)) for limit in (COVERAGE_68, COVERAGE_95))
    return dict(zip(names, (float(error[known].mean()), float(np.median(error[known])), *inside), strict=True))


def shortfalls(rows: list[Row]) -> list[str]:
    """Return what does not reach what it must."""
    found = []
    plain = {row.case: row for row in rows if row.method == "palette off"}
    for row in rows:
        if row.method != "default":
            continue
        median, worst = MUST.get(row.case, (np.inf, np.inf))
        if (row.left_out or 0.0) > median or (row.left_out_worst or 0.0) > worst:
            found.append(f"{row.case}: views left out to {row.left_out:.0%}, worst {row.left_out_worst:.0%}")
        if row.light_off_mm is not None and row.light_off_mm > LIGHT_MUST_MM:
            found.append(f"{row.case}: the light is {row.light_off_mm:.1f} mm off")
        if "dome" in row.case and (not row.told or (row.error_mean_deg or 0.0) > DOME_MUST_DEG):
            found.append(f"{row.case}: {row.error_mean_deg:.1f} deg, told: {', '.join(row.told) or 'nothing'}")
        other = plain.get(row.case)
        if other and row.left_out and other.left_out and row.left_out > WORSE_MUST * other.left_out:
            found.append(f"{row.case}: worse than without a palette ({row.left_out:.0%} against {other.left_out:.0%})")
    return found
