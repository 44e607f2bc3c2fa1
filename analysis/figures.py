"""Pictures of a result, as PNG bytes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.reflectance import Cosines
from analysis.result import Result

Array = NDArray[np.float64]

Point = tuple[int, int]

STYLE: dict[Any, Any] = {"font.size": 9, "axes.titlesize": 10, "figure.facecolor": "white", "savefig.dpi": 110}


def normal_colours(normals: Array) -> Array:
    """Return the usual false colours (n + 1) / 2 of unit normals; unsolved pixels are black."""
    return np.asarray(np.nan_to_num(np.clip((normals + 1.0) / 2.0, 0.0, 1.0)))


def display_colours(radiance: Array, white: float | None = None) -> Array:
    """Return linear radiance (..., 1 or 3) as display colours, `white` (99th percentile) made 1, by the sRGB curve."""
    level = white or float(np.nanpercentile(radiance, 99))
    linear = np.nan_to_num(np.clip(radiance / max(level, 1e-30), 0.0, 1.0))
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return np.asarray(np.broadcast_to(curve, (*curve.shape[:-1], 3)))


def picture(colours: Array) -> bytes:
    """Encode display colours (height, width, 3) pixel by pixel."""
    buffer = io.BytesIO()
    mpl.image.imsave(buffer, np.asarray(np.clip(colours, 0, 1)), format="png")
    return buffer.getvalue()


def scalar_map(values: Array, label: str, *, log: bool = False, marks: Sequence[Point] = ()) -> bytes:
    """Draw a map with its colour bar; the scale spans the 1st to the 99th percentile."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.2, 3.5), layout="constrained")
        axes = figure.add_subplot()
        finite = values[np.isfinite(values)]
        low, high = np.percentile(finite, [1, 99]) if finite.size else (0.0, 1.0)
        if log:
            norm: Normalize = LogNorm(max(low, 1e-6), max(high, 2e-6))
        else:
            norm = Normalize(low, high if high > low else low + 1e-6)
        shown = axes.imshow(
            values, norm=norm, cmap=mpl.colormaps["viridis"].with_extremes(bad="black"), interpolation="nearest"
        )
        figure.colorbar(shown, ax=axes, label=label, shrink=0.9)
        for number, (row, column) in enumerate(marks, start=1):
            axes.plot(column, row, "o", color="white", markeredgecolor="black", markersize=5)
            axes.annotate(str(number), (column, row), xytext=(4, 4), textcoords="offset points", color="white")
        axes.set_axis_off()
        return png(figure)


def group_map(groups: NDArray[np.int16]) -> bytes:
    """Draw a map of group numbers in distinct colours; -1 is black."""
    palette = mpl.colormaps["tab20"](np.arange(20) % 20)[:, :3]
    return picture(np.where(groups[..., None] < 0, 0.0, palette[np.maximum(groups, 0) % 20]))


def curves(result: Result, points: Sequence[Point], samples: Sequence[tuple[Array, Array]] = ()) -> bytes:
    """Draw the fitted curves f(theta_h) at picked points; dashed beyond the half angles seen there.

    Parameters
    ----------
    result : Result
    points : sequence of (row, column)
    samples : sequence of (theta_h, f)
        What was measured at each point: rad, shape (N,), and f = radiance d^2 / (P cos), shape (N, C).
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
                if len(samples) >= number:
                    angle, measured = samples[number - 1]
                    axes.plot(np.rad2deg(angle), measured[:, channel], ".", color=colour, markersize=3)
            axes.set(title=f"point {number}", xlabel="θh (deg)", ylabel="f (1/sr)" if number == 1 else "")
            _limit_to(axes, f)
        return png(figure)


def _limit_to(axes: mpl.axes.Axes, f: Array) -> None:
    positive = f[np.isfinite(f) & (f > 0.0)]
    if positive.size:
        axes.set_ylim(0.5 * float(np.percentile(positive, 1)), 2.0 * float(positive.max()))


def png(figure: Figure) -> bytes:
    """Encode a figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
