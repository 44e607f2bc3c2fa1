"""Whether a set of views can tell a normal from a reflectance curve at all."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.samples import MIN_VIEWS
from analysis.registration.stack import Stack
from instrument.files.validation import Problem

MIN_SPREAD = 0.01
"""Least ratio of the smallest to the largest singular value of the directions. A phone held over a card
reaches 0.1; below 0.01 a normal's error exceeds the noise a hundredfold."""


def view_problems(stack: Stack) -> Iterator[Problem]:
    """Yield why the views do not determine normals: too few, all in one plane, or all on one cone.

    With the directions omega_v to the light as rows, poses in one plane through the sample make the
    smallest singular value vanish; poses on one cone (one half angle for a flat sample) make that of the
    directions less their mean vanish, and then any slope of the curve trades against a tilt of the normal.
    """
    where = "/entry/geometry/light_position"
    if stack.n_views < MIN_VIEWS:
        yield Problem(where, f"{stack.n_views} views; at least {MIN_VIEWS} are needed. Capture more poses.")
        return
    directions = stack.light_position / np.linalg.norm(stack.light_position, axis=1, keepdims=True)
    if _spread(directions) < MIN_SPREAD:
        yield Problem(
            where,
            "all poses lie in one plane, so normals are free to tilt out of it. "
            "Add poses that turn the sample about another axis.",
        )
    elif _spread(directions - directions.mean(axis=0)) < MIN_SPREAD:
        yield Problem(
            where,
            "all poses lie on one cone, so a flat sample shows one half angle only and its normal cannot be told "
            "from the slope of its reflectance. Add poses at another tilt.",
        )


def _spread(directions: NDArray[np.float64]) -> float:
    singular = np.linalg.svd(directions, compute_uv=False)
    return float(singular[-1] / singular[0]) if singular[0] > 0.0 else 0.0
