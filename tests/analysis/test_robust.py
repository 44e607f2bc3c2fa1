from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from analysis.robust import MAD_TO_SIGMA, huber_weights, mad_sigma, sandwich, tukey_weights


def test_the_scale_of_a_gaussian_is_its_standard_deviation_whatever_a_third_of_the_samples_are():
    r = 0.3 * np.random.default_rng(0).standard_normal(100_000)
    assert mad_sigma(r) == pytest.approx(0.3, rel=0.01)
    r[::20] = 1e9
    assert mad_sigma(r) == pytest.approx(0.3, rel=0.1)


def test_the_scale_agrees_with_scipy():
    r = np.random.default_rng(1).standard_normal(999)
    expected = stats.median_abs_deviation(r, center=lambda x, axis: np.zeros(()), scale="normal")
    assert mad_sigma(r) == pytest.approx(expected, rel=1e-4)
    assert pytest.approx(1.0 / stats.norm.ppf(0.75), rel=1e-4) == MAD_TO_SIGMA


def test_the_scale_is_never_below_its_floor():
    assert mad_sigma(np.zeros(5), 1e-6) == 1e-6


def test_weights_fall_as_their_authors_say():
    r = np.array([-4.0, -2.0, 0.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(huber_weights(r, 2.0), [0.5, 1.0, 1.0, 1.0, 1.0, 2.0 / 3.0])
    np.testing.assert_allclose(tukey_weights(r, 2.0), [0.0, 0.0, 1.0, 0.75**2, 0.0, 0.0])


def test_the_sandwich_knows_that_samples_of_a_block_are_wrong_together():
    """The mean of blocks whose samples are copies: the variance is that of the blocks, not of the samples."""
    rng = np.random.default_rng(2)
    n_blocks, n_copies = 400, 25
    y = np.repeat(rng.standard_normal(n_blocks), n_copies)
    inverse = np.array([[1.0 / y.size]])
    pull = (y - y.mean()).reshape(n_blocks, n_copies).sum(axis=1)[:, None]
    assert sandwich(inverse, pull)[0, 0] == pytest.approx(1.0 / n_blocks, rel=0.15)
