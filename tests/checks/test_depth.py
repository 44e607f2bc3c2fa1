"""Depth: what integration makes of normals, and what ties it to the plane of the boards."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.depth.integration import integrate_normals
from analysis.evaluation.metrics import shape_terms
from analysis.pixels.problem import Noise
from analysis.reconstruction.gross_shape import NO_SHAPE, gross_shape
from analysis.reflectance.dictionary import parametric
from analysis.registration.stack_file import read_stack, write_stack
from instrument.files.validation import InvalidInputError
from tests.analysis.depth.test_integration import bump_up_right, error, quadratic, surface, with_holes
from tests.checks.conftest import Record
from tests.checks.simulated import Simulated
from tests.synthetic import make_stack, relief

PITCH = 0.3


@pytest.mark.check(17)
@pytest.mark.parametrize("holes", [False, True])
def test_a_paraboloid_comes_back_on_an_area_that_is_not_square(record: Record, holes: bool) -> None:
    truth, normals = surface(60, 95, quadratic, PITCH)
    depth = integrate_normals(with_holes(normals) if holes else normals, PITCH)
    what = (
        "the same with holes in it"
        if holes
        else "depth of a paraboloid on 60 x 95 pixels less the formula's, worst pixel"
    )
    record.at_most(what, error(depth, truth) / PITCH, 0.01, "px")


@pytest.mark.check(17)
def test_a_bump_to_the_upper_right_stays_there(record: Record) -> None:
    truth, normals = surface(60, 50, bump_up_right, PITCH)
    depth = integrate_normals(normals, PITCH)
    top, true_top = (np.array(np.unravel_index(np.argmax(z), z.shape)) for z in (depth, truth))
    record.at_most("top of a bump up and to the right, from where it is", np.abs(top - true_top).max(), 0, "px")
    record.at_most("its depth less the formula's, worst pixel", error(depth, truth) / PITCH, 0.01, "px")


@pytest.mark.check(17)
def test_pixels_that_are_not_square_are_refused(record: Record, tmp_path: Path) -> None:
    path = tmp_path / "s.stack.h5"
    write_stack(path, make_stack(n_views=5, size=4))
    with h5py.File(path, "r+") as file:
        del file["/entry/geometry/pixel_pitch"]
        file["/entry/geometry/pixel_pitch"] = [0.4, 0.5]
    with pytest.raises(InvalidInputError) as caught:
        read_stack(path)
    record.holds("a stack of pixels that are not square is refused", "pixels must be square" in str(caught.value))


@pytest.mark.check(18)
def test_a_depth_that_drifted_is_tied_to_the_plane_by_the_views(record: Record) -> None:
    stack = make_stack(n_views=30, size=64, pitch=0.5, registered_to="plane")
    x, y, _ = np.moveaxis(stack.grid.points(), -1, 0)
    drift = np.array([0.03, 0.03, -0.02])
    depth = relief(x, y)[0] + drift[0] + drift[1] * x / 16.0 + drift[2] * y / 16.0
    dictionary, noise, shape = parametric(), Noise(relative=4e-3, floor=0.0), NO_SHAPE
    # As the loop over the geometry does, on from what was found before.
    for _ in range(3):
        shape = gross_shape(stack, depth, dictionary, noise, shape, np.random.default_rng(0))
    left = np.abs(shape.coefficients[:3] + drift)
    for name, value in zip(("level", "tilt to the right", "tilt up"), left, strict=True):
        record.at_most(f"{name} that is left of a drift of 0.02 to 0.03 mm", value, 0.008, "mm")


@pytest.mark.check(18)
def test_plane_and_bowl_in_the_depth_are_reported(record: Record, simulated: Simulated) -> None:
    result, truth = simulated.reconstruction, simulated.truth
    names = {choice.effect for choice in result.choices}
    record.holds("the correction by the plane of the boards is reported", "gross shape" in names)
    off = shape_terms(result.depth - truth.depth, simulated.stack.pixel_pitch)
    tilt = np.rad2deg(np.hypot(off.tilt_x, off.tilt_y))
    record.at_most("tilt of the relief's depth against the boards' plane", tilt, 0.3, "°")
    bowl = shape_terms(-0.5 * 0.003 * np.sum(simulated.stack.grid.points() ** 2, axis=-1), simulated.stack.pixel_pitch)
    record.at_most("reported curvature of a bowl, over its own, less 1", abs(-bowl.bowl / 0.003 - 1.0), 1e-6)
