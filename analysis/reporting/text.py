"""What a terminal shows of a calibration and of a result."""

from __future__ import annotations

from analysis.reporting.calibration_report import CalibrationReport
from analysis.reporting.checks import Status, by_severity, count
from analysis.results.summary import Summary
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
    if s.n_unsolved:
        text.append(f"{s.n_unsolved} of {s.n_pixels} pixels unsolved (see flags)")
    if s.left_out:
        text.append(_held_out_table(s))
    return "\n".join(text)


def _held_out_table(summary: Summary) -> str:
    rows = [("view left out", "relative RMS", "Lambertian", "PSNR dB", "Lambertian", "gain on glossy dB")]
    for v in summary.left_out:
        shares = f"{100 * v.relative_rms:.2f} %", f"{100 * v.lambert_relative_rms:.2f} %"
        levels = f"{v.psnr_db:.1f}", f"{v.lambert_psnr_db:.1f}", f"{v.glossy_gain_db:.1f}"
        rows.append((str(v.view), *shares, *levels))
    return text_table(rows)
