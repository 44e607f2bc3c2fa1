"""Prints a calibration, a result and a pixel for the terminal."""

from __future__ import annotations

from typing import Any

import numpy as np

from analysis.reporting.calibration_report import CalibrationReport
from analysis.reporting.checks import Status, by_severity, count
from analysis.results.points import USES, PointCurve, PointSamples
from analysis.results.summary import Summary
from analysis.results.trust import cautions, failures
from analysis.stages import Stages
from instrument.files.text_table import text_table
from instrument.files.validation import LINE_BREAK, printable


def checks_text(report: CalibrationReport, *, all_checks: bool = False) -> str:
    """Return the checks that did not pass, or all, the worst first, and how many there are of each kind."""
    checks = by_severity(report.checks)
    lines = [
        f"{check.status.value}  {check.name}: {check.number} (allowed: {check.threshold}). Next: {check.remedy}"
        for check in checks
        if check.status is not Status.PASS
    ]
    if all_checks:
        lines += [f"PASS  {check.name}: {check.number}" for check in checks if check.status is Status.PASS]
    lines.append(f"calibration checks: {report.verdict}")
    if count(checks, Status.FAIL):
        lines.append("THE CALIBRATION FAILED: do not trust maps made with it before what failed is put right.")
    # Names and numbers come from the session, whoever made it.
    return printable("\n".join(lines), keep=LINE_BREAK)


def budget_text(contributions: dict[str, float]) -> str:
    """Return what each source adds to the normals, the largest first."""
    ordered = sorted(contributions.items(), key=lambda item: -item[1])
    each = ", ".join(f"{name} {deg:.3f}" for name, deg in ordered)
    return f"errors of the normals, deg per axis: {each}; {ordered[0][0]} dominates"


def summary_text(summary: Summary) -> str:
    """Return the figures that a user looks at first."""
    s = summary
    rows: list[tuple[str, ...]] = [("", "mean", "median", "95 %")]
    for name, value in (("normal error, deg", s.normal_error_deg), ("stated sigma, deg", s.normal_sigma_deg)):
        if value is not None:
            rows.append((name, f"{value.mean:.3f}", f"{value.median:.3f}", f"{value.p95:.3f}"))
    text = [text_table(rows)]
    if s.depth_rmse_mm is not None:
        plane = s.depth_rmse_without_plane_mm
        text.append(f"depth RMSE {s.depth_rmse_mm:.4f} mm, {plane:.4f} mm with the plane removed")
    if s.coverage68 is not None and s.coverage95 is not None:
        inside = f"{100 * s.coverage68:.0f} % and {100 * s.coverage95:.0f} %"
        text.append(f"stated 68 % and 95 % normal intervals hold {inside} of the true normals")
    if s.depth_shape is not None:
        tilt = f"({s.depth_shape.tilt_x:.5f}, {s.depth_shape.tilt_y:.5f}) mm/mm"
        text.append(f"plane and bowl in the depth: tilt {tilt}, bowl {s.depth_shape.sag:.4f} mm deep")
    if s.error_budget_deg is not None:
        text.append(budget_text(s.error_budget_deg))
    if s.left_out:
        text.append(_held_out_table(s))
    text += [*cautions(s), *failures(s)]
    return "\n".join(text)


def _held_out_table(summary: Summary) -> str:
    head = ("view left out", "relative RMS", "free gain", "Lambertian", "PSNR dB", "Lambertian", "gain on glossy dB")
    rows: list[tuple[str, ...]] = [head]
    for v in summary.left_out:
        with_gain = v.relative_rms if v.relative_rms_with_gain is None else v.relative_rms_with_gain
        shares = [f"{100 * share:.2f} %" for share in (v.relative_rms, with_gain, v.lambert_relative_rms)]
        levels = f"{v.psnr_db:.1f}", f"{v.lambert_psnr_db:.1f}", f"{v.glossy_gain_db:.1f}"
        rows.append((str(v.view), *shares, *levels))
    return text_table(rows)


def point_figures(curve: PointCurve, samples: PointSamples) -> dict[str, Any]:
    """Return the samples of a pixel beside its curve, as JSON has it."""
    return {
        "row": curve.row,
        "column": curve.column,
        "flags": list(curve.flags),
        "normal_sigma_rad": curve.normal_sigma,
        "theta_h_range_rad": list(curve.seen),
        "curve": {"theta_h_rad": curve.theta_h.tolist(), "f": curve.f.tolist()},
        "samples": {
            "theta_h_rad": samples.theta_h.tolist(),
            "f": samples.f.tolist(),
            "sigma": samples.sigma.tolist(),
            "use": [[USES[use] for use in view] for view in samples.use],
        },
    }


def point_text(curve: PointCurve, samples: PointSamples) -> str:
    """Return the samples of a pixel beside its curve, a line for each view and channel."""
    near, far, sigma = np.rad2deg([*curve.seen, curve.normal_sigma])
    seen = f"seen from {near:.1f} to {far:.1f} deg, normal known to {sigma:.3f} deg"
    head = [f"row {curve.row}, column {curve.column}: {seen}", *(f"flag: {flag}" for flag in curve.flags)]
    names = "RGB" if curve.f.shape[1] == 3 else ("grey",)
    rows: list[tuple[str, ...]] = [("view", "channel", "theta_h, deg", "f, 1/sr", "sigma", "fitted", "use")]
    for i_view in np.argsort(samples.theta_h):
        for channel, name in enumerate(names):
            theta_h = float(samples.theta_h[i_view])
            fitted = float(np.interp(theta_h, curve.theta_h, curve.f[:, channel]))
            values = (samples.f[i_view, channel], samples.sigma[i_view, channel], fitted)
            use = USES[samples.use[i_view, channel]]
            rows.append((str(i_view), name, f"{np.rad2deg(theta_h):.2f}", *(f"{v:.5g}" for v in values), use))
    return printable("\n".join([*head, text_table(rows)]), keep="\n")


def stages_text(stages: Stages) -> str:
    """Return what each stage took."""
    rows = [("stage", "seconds", "peak MB")]
    rows += [(s.name, f"{s.seconds:.1f}", f"{s.peak_mb:.0f}") for s in stages]
    rows.append(("all", f"{sum(s.seconds for s in stages):.1f}", ""))
    return text_table(rows)
