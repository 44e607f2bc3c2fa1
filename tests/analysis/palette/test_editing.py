"""Materials of a palette swapped and reweighted."""

import numpy as np
import pytest

from analysis.palette.editing import reweighted, swapped
from analysis.pixels.fits import PixelFits
from analysis.reflectance.dictionary import Atom
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette import NODES, Palette

GOLD = tuple(Atom("sgd", 30, channel) for channel in range(3))
ANGLES = Cosines.on_slice(np.deg2rad(np.tile([5.0, 30.0], (3, 1))))


@pytest.fixture
def fits() -> PixelFits:
    """Three pixels of two materials: of the first, of the second, of half of both."""
    curve = np.stack([np.full((3, len(NODES)), 0.4), np.full((3, len(NODES)), 0.1)])
    atom = np.full((3, 3, 4), -1, np.int16)
    channels = np.arange(3)
    atom[0, :, 0], atom[1, :, 0], atom[2, :, 0], atom[2, :, 1] = channels, 3 + channels, channels, 3 + channels
    coefficient = np.zeros((3, 3, 4))
    coefficient[:2, :, 0], coefficient[2, :, :2] = 0.5, 0.25
    return PixelFits(
        normals=np.tile([0.0, 0.0, 1.0], (3, 1)),
        covariance=np.zeros((3, 3)),
        reduced_chi2=np.ones(3),
        loss=np.ones(3),
        atom=atom,
        coefficient=coefficient,
        flags=np.zeros(3, np.uint8),
        theta_h_range=np.tile(np.deg2rad([1.0, 60.0]), (3, 1)),
        dictionary=Palette(curve).dictionary,
    )


def test_more_of_a_material_is_more_of_it_alone(fits: PixelFits) -> None:
    before, after = fits.brdf(ANGLES), reweighted(fits, 1, 3.0).brdf(ANGLES)
    np.testing.assert_allclose(after[0], before[0])
    np.testing.assert_allclose(after[1], 3.0 * before[1])
    np.testing.assert_allclose(after[2] - before[2], 2.0 * 0.25 * 0.1)


def test_none_of_a_material_leaves_the_others(fits: PixelFits) -> None:
    assert reweighted(fits, 0, 0.0).brdf(ANGLES)[0].max() == 0.0
    np.testing.assert_allclose(reweighted(fits, 0, 1.0).brdf(ANGLES), fits.brdf(ANGLES))


def test_another_material_comes_in_place_of_one_with_the_brdf_that_it_has(fits: PixelFits) -> None:
    edited = swapped(fits, 0, GOLD).brdf(ANGLES)
    gold = np.stack([atom.evaluate(Cosines.on_slice(np.deg2rad([5.0, 30.0]))) for atom in GOLD], axis=-1)
    # The typical share of the first material lies between its pixels': 0.5 and 0.25.
    np.testing.assert_allclose(edited[0], gold * 0.5 / 0.375)
    np.testing.assert_allclose(edited[1], fits.brdf(ANGLES)[1])
    np.testing.assert_allclose(edited[2], gold * 0.25 / 0.375 + 0.25 * 0.1)


def test_what_cannot_be_edited_is_refused(fits: PixelFits) -> None:
    with pytest.raises(ValueError, match="no material 2; the scene uses 0, 1"):
        reweighted(fits, 2, 1.0)
    with pytest.raises(ValueError, match="must not be negative"):
        reweighted(fits, 0, -1.0)
    with pytest.raises(ValueError, match="2 channels; the scene has 3"):
        swapped(fits, 0, GOLD[:2])
