"""CIEDE2000 against the test data that its implementers agreed on."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.drawing.colour_difference import ciede2000, lab_from_srgb

# From table 1 of Sharma, Wu and Dalal, 2005.
PAIRS = [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, 3.1571, -77.2803), (50.0, 0.0, -82.7485), 2.8615),
    ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0000),
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
    ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
]


@pytest.mark.parametrize(("first", "second", "expected"), PAIRS)
def test_it_agrees_with_the_published_pairs_both_ways_round(
    first: tuple[float, ...], second: tuple[float, ...], expected: float
) -> None:
    assert ciede2000(np.array(first), np.array(second)) == pytest.approx(expected, abs=1e-4)
    assert ciede2000(np.array(second), np.array(first)) == pytest.approx(expected, abs=1e-4)


def test_white_is_at_100_and_greys_have_no_chroma() -> None:
    lab = lab_from_srgb(np.array([[1.0, 1.0, 1.0], [0.5, 0.5, 0.5], [0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(lab[[0, 2], 0], [100.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(lab[:, 1:], 0.0, atol=1e-9)


def test_red_is_where_it_is_listed() -> None:
    np.testing.assert_allclose(lab_from_srgb(np.array([1.0, 0.0, 0.0])), [53.24, 80.09, 67.20], atol=0.01)
