"""What a user must know before trusting a result: said on the terminal, at the top of the report, by the exit code."""

from __future__ import annotations

import numpy as np

from analysis.reconstruction.effects import MAX_THETA_D_DEG
from analysis.results.summary import Summary

NOTHING_SOLVED = (
    "NO PIXEL IS SOLVED: the maps are empty. The flags say why: too few views see a pixel, or the pictures are black "
    "or clipped. Look at the stack and at its light."
)

NARROW_RANGE_DEG = 30.0
"""Largest half angle below which a curve's tail, and with it the diffuse part, is mostly extrapolated."""

WORSE_THAN_LAMBERT = 1.05
"""Ratio of the errors on views left out, beyond which what shading alone explains was explained better by it."""

LARGE_RESIDUAL = 0.03
"""Relative error of the model from which on something else than noise is in the pictures."""


def failures(summary: Summary) -> list[str]:
    """Return why the result is not to be trusted: a command that made it ends with the exit code for warnings."""
    s = summary
    found = [NOTHING_SOLVED] if s.n_unsolved == s.n_pixels else []
    ours, lambert = (
        float(np.median([getattr(view, name) for view in s.left_out])) if s.left_out else float("nan")
        for name in ("relative_rms", "lambert_relative_rms")
    )
    if ours > WORSE_THAN_LAMBERT * lambert:
        found.append(
            f"VIEWS LEFT OUT ARE PREDICTED WORSE THAN BY A LAMBERTIAN FIT ({100 * ours:.0f} % against "
            f"{100 * lambert:.0f} %, median): trust neither curves nor pictures from elsewhere. Check the light's "
            "position and power, gamma and registration; add poses."
        )
    if s.theta_d_deg is not None and s.theta_d_deg[0] > MAX_THETA_D_DEG:
        typical, largest = s.theta_d_deg
        camera = "The camera never moves and c" if s.camera_moves is False else "C"
        found.append(
            f"OUTSIDE THE DOMAIN: {camera}amera and light stand {typical:.0f} deg from their bisector in the typical "
            f"view, {largest:.0f} at most, as in a dome. BRDFs are meant for a light beside the lens (up to "
            f"{MAX_THETA_D_DEG:g} deg): the stated sigma of the normals is that of a Lambertian fit, and the "
            "reflectance is no measurement."
        )
    return found


def cautions(summary: Summary) -> list[str]:
    """Return what else a user must know."""
    s = summary
    found = []
    low, high = s.theta_h_range_deg
    if high < NARROW_RANGE_DEG:
        found.append(
            f"The typical pixel was seen at half angles of {low:.1f} to {high:.1f} deg only. Beyond them the BRDF is "
            "extrapolated, diffuse albedo and normals trade against each other, and the stated sigma does not cover "
            "that. Add poses with more tilt."
        )
    if 0 < s.n_unsolved < s.n_pixels:
        found.append(f"{s.n_unsolved} of {s.n_pixels} pixels are unsolved; their flags say why.")
    if s.relative_error > LARGE_RESIDUAL:
        found.append(
            f"Residuals are {100 * s.relative_error:.1f} % of the radiance: check gamma, exposure times, "
            "registration and the light's position."
        )
    return found
