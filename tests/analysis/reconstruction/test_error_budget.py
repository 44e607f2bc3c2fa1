"""Each stated error let loose: it grows with its sigma, and says what re-solving with the error itself says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.pixels.problem import Noise, PixelProblem
from analysis.reconstruction.error_budget import ErrorBudget, error_budget
from analysis.reflectance.dictionary import parametric
from analysis.registration.lighting import LightOffset, lit_from
from analysis.registration.stack import Stack
from tests.synthetic import make_stack

NOISE = Noise(relative=2e-3, floor=0.0)


@pytest.fixture(scope="module")
def stack() -> Stack:
    made = make_stack(n_views=40, size=20, light_offset=(12.0, 0.0, 0.0), noise=0.002)
    return replace(
        made,
        light_offset=np.array([12.0, 0.0, 0.0]),
        light_offset_sigma=np.array([0.5, 0.5, 2.0]),
        light_power_sigma=np.full(40, 0.002),
        registration_sigma=np.full(40, 0.002),
        falloff_sigma=0.002,
    )


def budget(stack: Stack) -> ErrorBudget:
    return error_budget(stack, parametric(), NOISE, np.random.default_rng(0))


@pytest.fixture(scope="module")
def stated(stack: Stack) -> ErrorBudget:
    return budget(stack)


def test_every_source_that_is_stated_has_its_share(stated: ErrorBudget):
    assert set(stated.contributions) == {"image noise", "light power", "light position", "registration", "fall-off"}
    assert all(deg > 0.0 for deg in stated.contributions.values())


def test_what_is_not_stated_is_not_in_the_budget(stack: Stack):
    bare = replace(stack, light_offset_sigma=None, light_power_sigma=None, registration_sigma=None, falloff_sigma=None)
    assert set(budget(bare).contributions) == {"image noise"}


@pytest.mark.parametrize("source", ["light_offset_sigma", "light_power_sigma", "registration_sigma", "falloff_sigma"])
def test_a_source_three_times_as_uncertain_costs_about_three_times_as_much(
    stack: Stack, stated: ErrorBudget, source: str
):
    name = {"light_offset_sigma": "light position", "light_power_sigma": "light power",
            "registration_sigma": "registration", "falloff_sigma": "fall-off"}[source]  # fmt: skip
    worse = budget(replace(stack, **{source: 3.0 * getattr(stack, source)}))
    assert 2.0 < worse.contributions[name] / stated.contributions[name] < 4.5


def test_the_dominant_source_is_named(stack: Stack):
    assert budget(replace(stack, falloff_sigma=0.2)).dominant == "fall-off"


def test_a_light_that_is_off_turns_the_normals_by_about_what_the_budget_says(stack: Stack, stated: ErrorBudget):
    pixels = np.arange(0, 400, 3)
    true = PixelProblem(stack, parametric(), pixels)
    base = true.solve(NOISE).normals
    turns = []
    for direction in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        offset = stack.light_offset + 0.5 * np.array([*direction, 0.0])
        moved = lit_from(stack, LightOffset(offset, stack.light_offset_sigma))
        normals = PixelProblem(moved, parametric(), pixels).solve(NOISE, start=base).normals
        turns.append(np.linalg.norm(normals - base, axis=1))
    # Both components at one sigma each; the RMS over directions, per tangent axis.
    expected = np.rad2deg(np.nanmedian(np.sqrt(2.0 * np.mean(np.square(turns), axis=0) / 2.0)))
    assert 0.5 < stated.contributions["light position"] / expected < 2.0


def test_what_all_views_share_is_kept_apart_from_what_residuals_show(stated: ErrorBudget):
    shared = [stated.contributions[name] for name in ("light position", "fall-off")]
    assert stated.systematic == pytest.approx(float(np.hypot(*shared)))
