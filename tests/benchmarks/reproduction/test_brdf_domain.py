import numpy as np
import pytest

from benchmarks.reproduction.brdf_domain import BANDS_DEG, LOWEST_ELEVATION_DEG, MAX_DEG, OFFSET, Domain
from benchmarks.reproduction.brdf_materials import PublishedBrdf

DOMAIN = Domain.whole()
TRUTH = PublishedBrdf("sgd", 30).at(DOMAIN.angles)


def test_the_bands_hold_every_node_once():
    count = sum(DOMAIN.band(*band).astype(int) for band in BANDS_DEG)
    assert (count == 1).all()
    assert DOMAIN.up_to(MAX_DEG).all()


def test_light_and_view_are_high_at_every_node():
    lowest = np.sin(np.deg2rad(LOWEST_ELEVATION_DEG))
    assert np.minimum(*DOMAIN.angles.n_dot_l_and_v).min() > lowest
    assert len(TRUTH) > 4000


def test_an_estimate_that_is_the_truth_has_no_error():
    assert DOMAIN.relative_error(TRUTH, TRUTH) == 0.0
    assert DOMAIN.log_error(TRUTH, TRUTH) == 0.0


@pytest.mark.parametrize("factor", [0.5, 1.1, 3.0])
def test_a_wrong_level_is_a_relative_error_everywhere(factor: float):
    assert DOMAIN.relative_error(factor * TRUTH, TRUTH) == pytest.approx(abs(factor - 1.0))
    assert DOMAIN.relative_error(factor * TRUTH, TRUTH, DOMAIN.band(*BANDS_DEG[2])) == pytest.approx(abs(factor - 1.0))
    bright = TRUTH + 1e3 * OFFSET / DOMAIN.weight[:, None]
    assert DOMAIN.log_error(factor * bright, bright) == pytest.approx(abs(np.log(factor)), rel=2e-3)


def test_a_table_over_the_nodes_is_the_same_at_all_phi_d():
    table = np.arange(46.0 * 17.0).reshape(46, 17)
    value = DOMAIN.from_table(table)
    np.testing.assert_array_equal(value, table[DOMAIN.i_h, DOMAIN.i_d])
