"""Pictures of what a calibration says of the light and of the poses, as PNG bytes."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.drawing.figures import STYLE, png, scalar_map
from analysis.light.flat_field import FlatField
from analysis.light.photometry import Photometry, WhiteSamples
from analysis.radiometry.response import Response
from analysis.registration.coverage import BIN_DEG, JUDGED_TO_DEG, MIN_VIEWS, MIN_VIEWS_FIRST, Coverage

Array = NDArray[np.float64]

_CELLS = 48  # across the map of the white's residuals


def powers(photometry: Photometry, seconds: Array, i_pose: NDArray[np.int64]) -> bytes:
    """Draw each view's power with its sigma, over time where times are known."""
    relative = photometry.light_power / photometry.light_power.mean()
    timed = bool(np.isfinite(seconds).all()) and float(np.ptp(seconds)) > 0.0
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.2, 3.2), layout="constrained")
        axes = figure.add_subplot()
        axes.errorbar(seconds if timed else i_pose, relative, photometry.light_power_sigma, fmt=".", capsize=2)
        axes.axhline(1.0, color="black", linewidth=0.8, linestyle="--")
        axes.set(xlabel="seconds since the start" if timed else "pose", ylabel="power over its mean")
        return png(figure)


def white_residuals(white: WhiteSamples, residual: Array, image_size: tuple[int, int]) -> bytes:
    """Draw the mean residual of the white at each place of the picture, all views together."""
    width, height = image_size
    rows = max(round(_CELLS * height / width), 1)
    edges = [np.linspace(-0.5, height - 0.5, rows + 1), np.linspace(-0.5, width - 0.5, _CELLS + 1)]
    at = white.pixel[:, ::-1]
    n = np.histogramdd(at, edges)[0]
    total = np.histogramdd(at, edges, weights=100.0 * residual)[0]
    return scalar_map(np.where(n > 0, total / np.maximum(n, 1), np.nan), "seen less fitted (%)")


def response_curve(response: Response) -> bytes:
    """Draw linear exposure over counts, dotted where it is extrapolated."""
    colours = ("tab:red", "tab:green", "tab:blue") if len(response.curve) == 3 else ("black",)
    level = np.arange(response.curve.shape[1])
    known = slice(response.lowest, response.highest + 1)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.2, 3.2), layout="constrained")
        axes = figure.add_subplot()
        for line, sigma, colour in zip(response.curve, response.sigma, colours, strict=True):
            axes.semilogy(level[1:], line[1:], ":", color=colour, linewidth=0.8)
            axes.semilogy(level[known], line[known], color=colour, linewidth=1.4)
            around = [line[known] * np.exp(s * sigma[known]) for s in (-1.0, 1.0)]
            axes.fill_between(level[known], *around, color=colour, alpha=0.2)
        axes.set(xlabel="count", ylabel="linear exposure", title="bands: ± sigma; dotted: extrapolated")
        return png(figure)


def flat_map(flat: FlatField, distance_mm: float) -> bytes:
    """Draw vignetting times lobe over the picture, the brightest made 1."""
    step = max(flat.image_size[0] // 160, 1)
    gain = flat.map(distance_mm)[::step, ::step]
    return scalar_map(gain / gain.max(), "vignetting times lobe")


def poses(camera_position: Array, i_pose: NDArray[np.int64], worst: int | None) -> bytes:
    """Draw the directions to the camera on the hemisphere, from above; rings are 15 deg of tilt apart."""
    x, y, z = camera_position.T
    tilt = np.rad2deg(np.arctan2(np.hypot(x, y), z))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.2, 4.0), layout="constrained")
        axes = figure.add_subplot(projection="polar")
        axes.plot(np.arctan2(y, x), tilt, "o", markersize=4)
        if worst is not None:
            axes.plot(np.arctan2(y, x)[worst], tilt[worst], "o", color="tab:red", markersize=6)
        axes.set_yticks(np.arange(15.0, max(float(tilt.max()), 45.0) + 10.0, 15.0))
        axes.set_xticks(np.deg2rad([0.0, 90.0, 180.0, 270.0]), ["right", "top", "left", "bottom"])
        note = "" if worst is None else f"; red: pose {i_pose[worst]}"
        axes.set_title(f"tilt of the camera (deg){note}")
        return png(figure)


def half_angles(reached: Coverage) -> bytes:
    """Draw how many views see the typical slope in each bin of half angles, for parts of slopes and area."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.6, 3.2), layout="constrained")
        titles = ("slopes that face", "half of the area")
        for place, (title, parts) in enumerate(zip(titles, (reached.slopes, reached.halves), strict=True), start=1):
            axes = figure.add_subplot(1, 2, place)
            axes.stairs(reached.all_over, reached.edges_deg, fill=True, color="0.85", label="all")
            for name, views in parts.items():
                axes.stairs(views, reached.edges_deg, label=name, linewidth=1.2)
            axes.hlines(MIN_VIEWS, BIN_DEG, JUDGED_TO_DEG, color="tab:red", linewidth=0.8, linestyle="--")
            axes.hlines(MIN_VIEWS_FIRST, 0.0, BIN_DEG, color="tab:red", linewidth=0.8, linestyle="--")
            axes.set(xlabel="half angle θh (deg)", title=title, ylabel="views a bin of 5 deg" if place == 1 else "")
            axes.legend(fontsize=8)
        return png(figure)
