"""One self-contained HTML page of a result."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.drawing.colours import display_colours, normal_colours
from analysis.drawing.figures import STYLE, Point, group_map, picture, png, scalar_map
from analysis.palette.materials import group_materials
from analysis.reflectance.models import Cosines
from analysis.results.result import FLAG_NAMES, MODEL_NAMES, Result, diffuse_albedo, model_used
from analysis.results.trust import cautions, failures
from instrument.files.whole_file import write_whole

Array = NDArray[np.float64]

N_PICKED = 4

Kind = type | tuple[type, ...] | dict[str, Any] | list[Any]


def write_report(path: Path, result: Result, title: str) -> None:
    """Write the page to a new file.

    Raises
    ------
    FileExistsError
        If there is a file already.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    groups = group_materials(result.fits)
    picked = picked_points(result, groups)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("analysis.reporting", "data"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("report.html").render(
        title=title,
        headline=_headline(result),
        failures=failures(result.summary),
        advice=cautions(result.summary),
        maps=_maps(result, groups, picked),
        curves=_encode(_curves(result, picked)) if picked else "",
        left_out=result.summary.left_out,
        choices=result.choices,
        calibration=_flat(result.summary.calibration or {}),
        stages=result.stages,
        flags=_flag_counts(result),
        models=_model_counts(result),
    )
    write_whole(path, page)


def picked_points(result: Result, groups: NDArray[np.int16]) -> list[Point]:
    """Pick a typical pixel of each of the largest material groups: the one of median chi-square."""
    points = []
    for group in range(min(N_PICKED, int(groups.max(initial=-1)) + 1)):
        members = np.flatnonzero(groups == group)
        order = np.argsort(result.fits.reduced_chi2[members], kind="stable")
        row, column = divmod(int(members[order[len(order) // 2]]), result.grid.width)
        points.append((row, column))
    return points


def _headline(result: Result) -> list[tuple[str, str]]:
    s = result.summary
    rows = [
        (
            "Area",
            f"{result.grid.width} × {result.grid.height} pixels of {result.grid.pitch:g} mm, {s.n_views} views",
        ),
    ]
    if s.normal_error_deg is not None:
        e = s.normal_error_deg
        rows.append(
            (
                "Normal error against the truth",
                f"mean {e.mean:.3f}, median {e.median:.3f}, 95 % {e.p95:.3f} deg",
            )
        )
    if s.depth_rmse_mm is not None:
        plane = f"{s.depth_rmse_without_plane_mm:.4f} mm with the plane removed"
        rows.append(("Depth error against the truth", f"RMS {s.depth_rmse_mm:.4f} mm; {plane}"))
    if s.depth_shape is not None:
        shape = s.depth_shape
        tilt = np.rad2deg(np.arctan(np.hypot(shape.tilt_x, shape.tilt_y)))
        text = f"tilt {tilt:.3f} deg, bowl {shape.sag:.4f} mm deep; a light placed or powered wrongly makes both"
        rows.append(("Plane and bowl in the depth", text))
    sigma = s.normal_sigma_deg
    rows.append(("Stated normal sigma", f"median {sigma.median:.3f}, 95 % below {sigma.p95:.3f} deg"))
    if s.coverage68 is not None and s.coverage95 is not None:
        inside = f"{100 * s.coverage68:.0f} % and {100 * s.coverage95:.0f} %"
        rows.append(("Stated 68 % and 95 % intervals", f"hold {inside} of the true normals"))
    low, high = s.theta_h_range_deg
    rows.append(("Half angles seen by the typical pixel", f"{low:.1f} to {high:.1f} deg"))
    left_out = s.left_out
    if left_out:
        ours, lambert = (
            float(np.median([getattr(v, k) for v in left_out])) for k in ("relative_rms", "lambert_relative_rms")
        )
        rows.append(
            (
                "Error on views left out",
                f"median relative RMS {100 * ours:.2f} %; a Lambertian fit has {100 * lambert:.2f} %",
            )
        )
    return rows


def _maps(result: Result, groups: NDArray[np.int16], picked: list[Point]) -> list[tuple[str, str]]:
    fits = result.fits
    albedo = result.as_map(diffuse_albedo(fits))
    overhead = np.array([0.0, 0.0, 350.0])
    aside = np.array([250.0, 150.0, 300.0])
    drawn = [
        ("Normals, false colour", picture(normal_colours(result.normals))),
        ("Relit from the right, seen from above", picture(_lit(result, overhead, aside))),
        ("Diffuse albedo (π f at 45° or as far as seen)", picture(display_colours(albedo))),
        ("Groups of like reflectance", group_map(result.as_map(groups))),
        (
            "Stated sigma of the normal",
            scalar_map(result.as_map(np.rad2deg(fits.normal_sigma)), "deg", log=True),
        ),
        (
            "Residual",
            scalar_map(result.as_map(fits.reduced_chi2), "reduced chi-square", log=True, marks=picked),
        ),
    ]
    if np.isfinite(result.depth).any():
        drawn.insert(1, ("Depth", scalar_map(result.depth, "mm")))
        drawn.append(("Stated sigma of the depth", scalar_map(result.depth_sigma, "mm")))
    if result.truth_error is not None:
        drawn.append(("Normal error against the truth", scalar_map(result.truth_error, "deg", log=True)))
    return [(caption, _encode(png)) for caption, png in drawn]


def _lit(result: Result, camera: Array, light: Array) -> Array:
    return display_colours(result.render(camera, light))


def _flag_counts(result: Result) -> list[tuple[str, int]]:
    return [(text, int(np.count_nonzero(result.fits.flags & bit))) for bit, text in FLAG_NAMES.items()]


def _model_counts(result: Result) -> list[tuple[str, int]]:
    counts = np.bincount(model_used(result.fits), minlength=len(MODEL_NAMES))
    return list(zip(MODEL_NAMES, counts.tolist(), strict=True))


def _flat(values: dict[str, Any]) -> list[tuple[str, str]]:
    """Figures as text; nested ones are joined."""
    return [(name.replace("_", " "), _text(value)) for name, value in values.items()]


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return ", ".join(f"{k} {_text(v)}" for k, v in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_text(v) for v in value) or "none"
    return str(value)


def _encode(png: bytes) -> str:
    return base64.b64encode(png).decode("ascii")


def _curves(result: Result, points: Sequence[Point]) -> bytes:
    """Draw the fitted curves f(theta_h) at picked points; dashed beyond the half angles seen there.

    Parameters
    ----------
    result : Result
    points : sequence of (row, column)
    """
    theta = np.deg2rad(np.linspace(0.0, 85.0, 300))
    colours = ("tab:red", "tab:green", "tab:blue") if result.fits.atom.shape[1] == 3 else ("black",)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3.1 * len(points), 2.9), layout="constrained")
        for number, (row, column) in enumerate(points, start=1):
            axes = figure.add_subplot(1, len(points), number)
            index = row * result.grid.width + column
            near, far = result.fits.theta_h_range[index]
            f = result.fits.select(np.array([index])).brdf(Cosines.on_slice(theta[None]))[0]
            seen = (theta >= near) & (theta <= far)
            for channel, colour in enumerate(colours):
                axes.semilogy(np.rad2deg(theta), f[:, channel], "--", color=colour, linewidth=0.7)
                axes.semilogy(np.rad2deg(theta[seen]), f[seen, channel], color=colour, linewidth=1.4)
            axes.set(title=f"point {number}", xlabel="θh (deg)", ylabel="f (1/sr)" if number == 1 else "")
            _limit_to(axes, f)
        return png(figure)


def _limit_to(axes: mpl.axes.Axes, f: Array) -> None:
    positive = f[np.isfinite(f) & (f > 0.0)]
    if positive.size:
        axes.set_ylim(0.5 * float(np.percentile(positive, 1)), 2.0 * float(positive.max()))
