"""Estimates normals of a few thousand cells from the previews of a capture while it runs.

The per-pixel solver of the reconstruction, with everything left out that needs a calibration or takes long: views lie
where the rig file says, cells have nothing to do with each other, and each starts from the plate's normal only. Its
worst errors stand where the reflectance jumps, since nominal views do not lie on each other exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.identifiability import view_problems
from analysis.pixels.problem import Noise, PixelProblem
from analysis.quick_look.views import quick_stack
from analysis.reflectance import dictionary
from analysis.registration.coverage import Coverage, coverage
from analysis.registration.stack import Stack
from instrument.session.nominal_views import NominalViews
from instrument.session.preview import Preview

Array = NDArray[np.float64]

RELATIVE_ERROR = 0.05
"""Of a radiance: fall-off, vignetting and registration as nobody has calibrated them."""

_FLOOR = 1e-3  # of the typical radiance: what holds up dark samples

_PLATE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class QuickLook:
    """What the poses so far tell of the sample.

    Attributes
    ----------
    normals : ndarray, shape (H, W, 3)
        Unit normals; NaN where there are none.
    sigma_deg : ndarray, shape (H, W)
        Standard deviation of the normals per tangent axis, by the scatter that is assumed of nominal views.
    pitch : float
        Size of a cell, mm.
    used, dark : tuple of int
        Poses that it was made of, and those left out because their pictures are black.
    coverage : Coverage or None
        Half angles that the poses used reach; None without poses.
    problems : tuple of str
        Why there are no normals; empty if there are.
    """

    normals: Array
    sigma_deg: Array
    pitch: float
    used: tuple[int, ...]
    dark: tuple[int, ...]
    coverage: Coverage | None
    problems: tuple[str, ...]

    @property
    def median_sigma_deg(self) -> float:
        """The typical `sigma_deg`; NaN where there are no normals."""
        solved = np.isfinite(self.sigma_deg)
        return float(np.median(self.sigma_deg[solved])) if solved.any() else np.nan

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON has it: without the pictures, but for how much of them there is."""
        solved = np.isfinite(self.normals[..., 2])
        return {
            "poses_used": list(self.used),
            "poses_dark": list(self.dark),
            "cells": list(solved.shape),
            "cell_mm": self.pitch,
            "solved_share": float(solved.mean()),
            "median_sigma_deg": self.median_sigma_deg if solved.any() else None,
            "coverage": None if self.coverage is None else self.coverage.as_dict(),
            "problems": list(self.problems),
        }


def quick_look(views: NominalViews, previews: Mapping[int, Preview]) -> QuickLook:
    """Look at the previews of some poses; one processor works for about a second at 65 poses.

    Parameters
    ----------
    views : NominalViews
        Of all poses.
    previews : mapping of int to Preview
        By pose.
    """
    dark = _dark(previews)
    used = tuple(i_pose for i_pose in sorted(previews) if i_pose not in dark)
    stack = quick_stack(views, {i_pose: previews[i_pose] for i_pose in used})
    problems = tuple(problem.what for problem in view_problems(stack))
    normals, sigma = _unsolved(stack) if problems else _solved(stack)
    reached = coverage(stack.camera_position, stack.light_position, views.area_mm) if used else None
    return QuickLook(normals, sigma, stack.pixel_pitch, used, dark, reached, problems)


def _dark(previews: Mapping[int, Preview]) -> tuple[int, ...]:
    """Return the poses whose picture is black beside the others, as when the light stayed off."""
    brightness = {i_pose: float(np.mean(preview.picture)) for i_pose, preview in previews.items()}
    typical = float(np.median(list(brightness.values()))) if brightness else 0.0
    return tuple(i_pose for i_pose in sorted(brightness) if not brightness[i_pose] > 0.01 * max(typical, 0.0))


def _unsolved(stack: Stack) -> tuple[Array, Array]:
    shape = (stack.grid.height, stack.grid.width)
    return np.full((*shape, 3), np.nan), np.full(shape, np.nan)


def _solved(stack: Stack) -> tuple[Array, Array]:
    problem = PixelProblem(stack, dictionary.by_name("parametric"))
    noise = Noise(RELATIVE_ERROR, _FLOOR * float(np.nanmedian(stack.radiance)))
    start = np.tile(_PLATE, (len(problem.pixels), 1))
    # One thread: the capture goes on beside it.
    fits = problem.solve(noise, start=start, threads=1)
    shape = (stack.grid.height, stack.grid.width)
    return fits.normals.reshape(*shape, 3), np.rad2deg(fits.normal_sigma).reshape(shape)
