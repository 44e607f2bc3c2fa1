"""Stacks and fits that several tests look at; each is made once."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import Noise, PixelProblem
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.reflectance.dictionary import parametric
from analysis.registration.stack import Stack
from tests.synthetic import make_stack

NOISE = Noise(relative=1e-3, floor=0.0)
"""The variance in a synthetic stack is the truth; next to nothing is added to it."""


def solve(stack: Stack, pixels: np.ndarray | None = None, **options: object) -> PixelFits:
    """Solve pixels on their own, flat, with the default dictionary."""
    return PixelProblem(stack, parametric(), pixels).solve(NOISE, **options)


@pytest.fixture(scope="session")
def stack() -> Stack:
    """40 views of 24 x 24 pixels with 0.5 % noise, registered to the surface, the light in the lens."""
    return make_stack(n_views=40, size=24)


@pytest.fixture(scope="session")
def fits(stack: Stack) -> PixelFits:
    return solve(stack)


@pytest.fixture(scope="session")
def reconstruction(stack: Stack) -> Reconstruction:
    return reconstruct(stack)
