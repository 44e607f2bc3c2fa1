from dataclasses import astuple

import numpy as np
import pytest

from analysis.evaluation.metrics import shape_terms
from analysis.registration.grid import Grid


def tilted_bowl(height: int, width: int, pitch: float) -> np.ndarray:
    x, y, _ = np.moveaxis(Grid(height, width, pitch).points(), -1, 0)
    return 7.0 + 0.01 * x - 0.02 * y + 0.5 * 0.003 * (x * x + y * y)


def test_tilt_and_bowl_are_those_of_the_surface():
    terms = shape_terms(tilted_bowl(41, 61, 0.5), 0.5)
    assert terms.tilt_x == pytest.approx(0.01)
    assert terms.tilt_y == pytest.approx(-0.02)
    assert terms.bowl == pytest.approx(0.003)
    assert terms.sag == pytest.approx(0.5 * 0.003 * (15.0**2 + 10.0**2))
    assert terms.rms > terms.rms_without_plane > 0.01
    assert terms.rms_without_bowl < 1e-9


def test_holes_do_not_change_the_terms():
    depth = tilted_bowl(41, 61, 0.5)
    depth[3:20, 5:40] = np.nan
    assert shape_terms(depth, 0.5).bowl == pytest.approx(0.003)
    assert shape_terms(depth, 0.5).rms_without_bowl < 1e-9


def test_a_single_row_has_no_tilt_across_it():
    terms = shape_terms(tilted_bowl(1, 30, 0.5), 0.5)
    assert terms.tilt_x == pytest.approx(0.01)
    assert terms.tilt_y == 0.0


def test_without_depth_there_are_no_terms():
    assert np.isnan(astuple(shape_terms(np.full((3, 4), np.nan), 0.5))).all()
