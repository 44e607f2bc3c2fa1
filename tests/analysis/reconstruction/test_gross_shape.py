"""Level, tilt and bowl of a depth that is wrong on purpose, found from the parallax alone."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.pixels.problem import Noise
from analysis.reconstruction.gross_shape import NO_SHAPE, GrossShape, gross_shape
from analysis.reflectance.dictionary import parametric
from analysis.registration.stack import Stack
from tests.synthetic import make_stack, relief

NOISE = Noise(relative=4e-3, floor=0.0)


@pytest.fixture(scope="module")
def plane_stack() -> Stack:
    return make_stack(n_views=40, size=64, registered_to="plane", pitch=0.5)


def true_depth(stack: Stack) -> np.ndarray:
    points = stack.grid.points()
    return relief(points[..., 0], points[..., 1])[0]


def found(stack: Stack, depth: np.ndarray) -> GrossShape:
    return gross_shape(stack, depth, parametric(), NOISE, NO_SHAPE, np.random.default_rng(0))


def test_a_depth_that_is_right_is_left_nearly_alone(plane_stack: Stack):
    correction = found(plane_stack, true_depth(plane_stack)).depth(plane_stack)
    assert np.abs(correction).max() < 0.01


@pytest.mark.parametrize(("term", "size"), [(0, 0.03), (1, 0.03), (2, -0.02)])
def test_a_level_or_a_tilt_put_into_the_depth_is_found(plane_stack: Stack, term: int, size: float):
    error = GrossShape(size * np.eye(4)[term], np.full(4, np.inf))
    shape = found(plane_stack, true_depth(plane_stack) + error.depth(plane_stack))
    left = shape.coefficients + error.coefficients
    assert np.abs(left[:3]).max() < 0.3 * abs(size)
    assert np.all(shape.sigma[:3] < 0.01)


def test_the_correction_can_go_on_from_an_earlier_one(plane_stack: Stack):
    depth = true_depth(plane_stack)
    start = GrossShape(np.array([-0.06, 0.0, 0.0, 0.0]), np.full(4, np.inf))
    on = gross_shape(plane_stack, depth + 0.07, parametric(), NOISE, start, np.random.default_rng(0))
    assert on.coefficients[0] == pytest.approx(-0.07, abs=0.006)
