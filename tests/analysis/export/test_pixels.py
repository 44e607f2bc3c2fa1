"""Surfaces of pixels: classes of like mixture, and pixels of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.export.maps import cropped, prepare
from analysis.export.options import Crop
from analysis.export.pixels import classes, pixel_surfaces
from analysis.results.result import Result
from instrument.files.validation import InvalidInputError
from tests.analysis.export.scene import GOLD, LACQUER, PAPER, PITCH, SIZE, material_map, small_result


@pytest.fixture(scope="module")
def result() -> Result:
    return small_result()


def test_pixels_of_like_mixture_share_a_class_and_others_have_their_own(result: Result):
    in_palette, class_of, first = classes(result.fits)
    assert np.count_nonzero(~in_palette) == 1
    own = int(np.flatnonzero(~in_palette)[0])
    assert np.count_nonzero(class_of == class_of[own]) == 1
    assert len(first) < 60
    material = material_map().ravel()
    middle = slice(SIZE * (SIZE // 2), SIZE * (SIZE // 2 + 1))
    pure = np.ones(len(material), bool)
    pure[middle] = False
    for number in np.unique(class_of[pure]):
        assert len(np.unique(material[pure & (class_of == number)])) == 1
    assert len(np.unique(class_of[middle])) == 33


def test_a_class_takes_on_the_level_of_each_pixel(result: Result):
    fits = result.fits.select(np.flatnonzero(np.isfinite(result.fits.normals[:, 0])))
    paper = np.flatnonzero(material_map().ravel()[np.isfinite(result.fits.normals[:, 0])] == PAPER)[:15]
    found = pixel_surfaces(fits, 1.0)
    ratio = found.surfaces.base_color[paper, 0] / fits.coefficient[paper, 0, 0]
    np.testing.assert_allclose(ratio, ratio[0], rtol=2e-3)


def test_without_a_palette_every_pixel_is_fitted(result: Result):
    fits = replace(result.fits, dictionary=replace(result.fits.dictionary, name="parametric"))
    with_palette, without = (pixel_surfaces(f.select(np.arange(400, 440)), 1.0) for f in (result.fits, fits))
    assert without.n_classes == 0
    assert not without.in_palette.any()
    np.testing.assert_allclose(without.surfaces.base_color, with_palette.surfaces.base_color, atol=0.02)


def test_colours_that_would_be_above_one_are_counted():
    prepared = prepare(small_result(scale=2.0), white_reflectance=1.0)
    assert prepared.counts.n_clipped > 100
    assert prepared.maps.surfaces.base_color.max() <= 1.0
    assert prepared.counts.n_dull > 100
    fitting = prepare(small_result(), white_reflectance=1.0).counts
    assert (fitting.n_clipped, fitting.n_dull) == (0, 0)


def test_the_scale_is_as_given_or_stated(result: Result):
    assert prepare(result, white_reflectance=0.5).scale.factor == 0.5
    found = prepare(result).scale
    assert "no white known" in found.reason
    calibrated = replace(result, summary=replace(result.summary, calibration={"white_rms": 0.001}))
    assert prepare(calibrated).scale.factor == 0.85
    assert "white paper taken for 0.85" in prepare(calibrated).scale.reason


def test_without_a_white_a_sample_is_no_brighter_than_its_highlights_allow(result: Result):
    glossy, matte = cropped(result, Crop(22, 0, 16, 16)), cropped(result, Crop(6, 26, 8, 8))
    assert "stay below 0.57;" in prepare(glossy).scale.reason
    assert "stay below 0.8;" in prepare(matte).scale.reason


def test_a_part_of_the_area_is_that_part_of_the_maps(result: Result):
    whole, part = prepare(result, white_reflectance=1.0), prepare(result, Crop(4, 8, 20, 12), white_reflectance=1.0)
    assert part.maps.shape == (12, 20)
    assert part.maps.size_mm == pytest.approx((20 * PITCH, 12 * PITCH))
    np.testing.assert_array_equal(part.maps.normals, whole.maps.normals[8:20, 4:24])
    inside = whole.maps.displacement[8:20, 4:24]
    np.testing.assert_allclose(part.maps.displacement, inside - inside.mean(), atol=1e-12)


def test_fewer_pixels_are_averages_of_the_same_size(result: Result):
    fine, coarse = prepare(result, white_reflectance=1.0), prepare(result, resolution=20, white_reflectance=1.0)
    assert coarse.maps.shape == (20, 20)
    assert coarse.maps.size_mm == fine.maps.size_mm
    expected = fine.maps.displacement.reshape(20, 2, 20, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse.maps.displacement, expected, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(coarse.maps.normals, axis=-1), 1.0)
    assert coarse.maps.material_shares.shape == (20, 20, fine.maps.material_shares.shape[-1])


def test_unsolved_pixels_are_filled_and_told(result: Result):
    maps = prepare(result, white_reflectance=1.0).maps
    assert np.flatnonzero(~maps.solved.ravel()).tolist() == [0, 1, 41]
    np.testing.assert_array_equal(maps.normals[0, 0], [0.0, 0.0, 1.0])
    assert np.isnan(maps.normal_sigma_deg[0, 0])
    assert np.isfinite(maps.displacement).all()
    np.testing.assert_allclose(maps.surfaces.base_color[0], maps.surfaces.base_color[2], rtol=0.05)


def test_shares_of_materials_are_those_of_the_mixture(result: Result):
    shares = prepare(result, white_reflectance=1.0).maps.material_shares
    np.testing.assert_allclose(shares[SIZE // 2, :, PAPER], np.linspace(1.0, 0.0, SIZE), atol=1e-9)
    np.testing.assert_allclose(shares[SIZE // 2, :, LACQUER], np.linspace(0.0, 1.0, SIZE), atol=1e-9)
    assert shares[SIZE // 4, SIZE // 4, GOLD] == 1.0
    assert not shares[SIZE - 1, 0].any()


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"crop": Crop(30, 0, 20, 5)}, "--crop: is 30,0,20,5; the area has 40 x 40 pixels"),
        ({"resolution": 41}, "--resolution: is 41; no more than 40 pixels were measured"),
        ({"crop": Crop(0, 0, 2, 1)}, "no pixel of it is solved"),
    ],
)
def test_what_is_not_there_is_refused(result: Result, choices: dict[str, object], message: str):
    with pytest.raises(InvalidInputError, match="cannot be exported") as refused:
        prepare(result, **choices)
    assert message in str(refused.value)
