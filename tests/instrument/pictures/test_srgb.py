from __future__ import annotations

import numpy as np

from instrument.pictures.srgb import linear_from_srgb, srgb_from_linear


def test_the_two_curves_undo_each_other():
    v = np.linspace(0.0, 1.0, 1001)
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(v)), v, atol=1e-7)


def test_half_the_light_is_shown_as_188_of_255():
    assert round(255 * float(srgb_from_linear(np.array(0.5)))) == 188
