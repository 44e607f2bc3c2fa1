"""Pictures of what a calibration leaves of the corners, as PNG bytes."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from numpy.typing import NDArray

from analysis.camera.calibration import CameraCalibration
from analysis.camera.residual_arrows import REGIONS, by_region, exaggeration
from analysis.drawing.figures import STYLE, png

Array = NDArray[np.float64]

_BRIGHTEST = 99.0  # percentile of a preview that is drawn white


def residual_vectors(camera: CameraCalibration, image_size: tuple[int, int]) -> bytes:
    """Draw the residuals of all corners of all views where they lie in the picture, coloured by direction."""
    points = np.concatenate([c.image_points for c in camera.corners])
    residuals = np.concatenate(camera.residuals)
    with mpl.rc_context(STYLE):
        figure, axes = _over_picture(image_size)
        times = exaggeration(residuals, image_size)
        quiver = _arrows(axes, points, residuals, times, cmap="hsv", clim=(-np.pi, np.pi), width=0.0022)
        quiver.set_array(np.arctan2(residuals[:, 1], residuals[:, 0]))
        axes.set_title(f"found less predicted, {times:g} times as long; colour is direction")
        return png(figure)


def regional_means(camera: CameraCalibration, image_size: tuple[int, int]) -> bytes:
    """Draw the mean residual of each region of the picture; its colour is the mean over its standard error.

    Scatter averages out there: what is left is what the lens model does not know.
    """
    points = np.concatenate([c.image_points for c in camera.corners])
    residuals = np.concatenate(camera.residuals)
    centres, means, errors = by_region(points, residuals, image_size)
    with mpl.rc_context(STYLE):
        figure, axes = _over_picture(image_size)
        times = exaggeration(means, image_size, 1.0 / REGIONS[0])
        quiver = _arrows(axes, centres, means, times, cmap="viridis", clim=(0.0, 5.0), width=0.006)
        quiver.set_array(np.linalg.norm(means, axis=1) / errors)
        figure.colorbar(quiver, ax=axes, shrink=0.7, label="over its standard error")
        axes.set_title(f"mean of each region, {times:g} times as long")
        return png(figure)


def worst_view(
    camera: CameraCalibration, preview: NDArray[np.float32], image_size: tuple[int, int], name: str
) -> bytes:
    """Draw the residuals of the worst view, and the corners left out there, on a small picture of it."""
    v = int(camera.view_rms.argmax())
    residuals = camera.residuals[v]
    with mpl.rc_context(STYLE):
        figure, axes = _over_picture(image_size)
        width, height = image_size
        block = width // preview.shape[1]
        # A preview is cut to whole blocks.
        extent = (-0.5, preview.shape[1] * block - 0.5, preview.shape[0] * block - 0.5, -0.5)
        white = float(np.percentile(preview, _BRIGHTEST))
        axes.imshow(np.clip(preview / max(white, 1e-30), 0.0, 1.0) ** 0.45, cmap="gray", extent=extent)
        axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
        times = exaggeration(residuals, image_size)
        _arrows(axes, camera.corners[v].image_points, residuals, times, color="tab:red", width=0.004)
        out = np.array([o.point for o in camera.outliers if o.view == v]).reshape(-1, 2)
        axes.plot(out[:, 0], out[:, 1], "x", color="tab:orange")
        note = f"; {len(out)} left out (x)" if len(out) else ""
        axes.set_title(f"{name}: {camera.view_rms[v]:.4f} px RMS, {times:g} times as long{note}")
        return png(figure)


def view_bars(camera: CameraCalibration, i_pose: NDArray[np.int64]) -> bytes:
    """Draw each view's RMS, the worst named, over what the median view has."""
    n = len(camera.view_rms)
    worst = int(camera.view_rms.argmax())
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.2, 3.2), layout="constrained")
        axes = figure.add_subplot()
        axes.bar(np.arange(n), camera.view_rms, color=["tab:red" if v == worst else "tab:blue" for v in range(n)])
        axes.axhline(float(np.median(camera.view_rms)), color="black", linewidth=0.8, linestyle="--")
        axes.annotate(f"pose {i_pose[worst]}", (worst, camera.view_rms[worst]), ha="center", va="bottom")
        axes.margins(y=0.12)
        axes.set(xlabel="view", ylabel="RMS of its corners (px)", title="dashed: median")
        return png(figure)


def normalised_histogram(lengths: Array) -> bytes:
    """Draw residual lengths over their sigmas with the Rayleigh density that they should have."""
    r = np.linspace(0.0, 6.0, 200)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.2, 3.2), layout="constrained")
        axes = figure.add_subplot()
        axes.hist(
            np.minimum(lengths, 6.0), bins=np.linspace(0.0, 6.0, 41).tolist(), density=True, color="tab:blue", alpha=0.6
        )
        axes.plot(r, r * np.exp(-0.5 * r * r), color="black", linewidth=1.0)
        axes.set(xlabel="residual over its sigma", ylabel="density", title="line: as Gaussian errors would be")
        return png(figure)


def print_displacements(camera: CameraCalibration) -> bytes:
    """Draw for each board by how much its corners lie beside where the print should have them."""
    layout = camera.bundle.state.layout
    n_boards = len(layout.position)
    columns = min(n_boards, 2)
    rows = -(-n_boards // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.6 if columns == 1 else 6.0, 2.6 * rows + 0.3), layout="constrained")
        for b in range(n_boards):
            axes = figure.add_subplot(rows, columns, b + 1)
            of = np.flatnonzero(layout.board == b)
            in_plane, out = 1e3 * layout.displacement[of][:, :2], 1e3 * layout.displacement[of][:, 2]
            place = layout.points(of)[:, :2]
            largest = max(float(np.abs(out).max(initial=0.0)), 1e-3)
            shown = axes.scatter(place[:, 0], place[:, 1], c=out, cmap="RdBu", vmin=-largest, vmax=largest, s=18)
            longest = max(float(np.linalg.norm(in_plane, axis=1).max(initial=0.0)), 1e-9)
            pitch = float(np.ptp(place, axis=0).max()) / max(np.sqrt(len(of)), 1.0)
            axes.quiver(*place.T, *in_plane.T, angles="xy", scale_units="xy", scale=longest / pitch, width=0.006)
            axes.set_title(f"board {b}: up to {longest:.3g} µm")
            axes.set(aspect="equal", xticks=[], yticks=[])
            # Arrows do not count when axes choose their limits.
            axes.update_datalim(place + in_plane * pitch / longest)
            axes.margins(0.15)
            axes.autoscale_view()
            figure.colorbar(shown, ax=axes, shrink=0.7, label="up (µm)" if (b + 1) % columns == 0 else "")
        return png(figure)


def _over_picture(image_size: tuple[int, int]) -> tuple[Figure, Axes]:
    width, height = image_size
    figure = Figure(figsize=(5.6, 5.6 * height / width + 0.5), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="x (px)", ylabel="y (px)")
    return figure, axes


def _arrows(axes: Axes, points: Array, residuals: Array, times: float, **style: Any) -> Quiver:
    return axes.quiver(*points.T, *residuals.T, angles="xy", scale_units="xy", scale=1.0 / times, **style)
