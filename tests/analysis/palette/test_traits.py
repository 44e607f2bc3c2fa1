"""Material traits: what they tell apart, what they are invariant to, and that they say how sure they are."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.palette.traits import GROUPED, TRAITS, TraitModel, Traits, pixel_traits, trait_index, trait_model
from analysis.pixels.fits import PixelFits
from analysis.reflectance.atoms import published
from analysis.reflectance.categories import categories
from analysis.reflectance.dictionary import Atom, Dictionary, parametric
from analysis.reflectance.models import Cosines, abc, sgd
from analysis.reflectance.palette import NODES, Palette

THETA_H = np.deg2rad(np.linspace(1.0, 60.0, 48))
SCENE = ("gold-paint", "green-fabric", "blue-acrylic", "orange-paint", "red-specular-plastic")


def curves(table: str, names: tuple[str, ...] = SCENE) -> np.ndarray:
    model = {"sgd": sgd, "abc": abc}[table]
    rows = {str(row["name"]): row for row in published(table)}
    return np.stack([model(Cosines.on_slice(THETA_H), rows[name]) for name in names])


@pytest.fixture(scope="module")
def model() -> TraitModel:
    return trait_model(THETA_H, tables=("abc",), judged=SCENE)


def test_every_material_of_the_tables_has_a_category() -> None:
    for table in ("sgd", "abc"):
        assert {str(name) for name in published(table)["name"]} <= set(categories())


def test_the_groups_are_the_six_traits_of_the_paper_each_once() -> None:
    assert sorted(trait for traits in GROUPED.values() for trait in traits) == sorted(TRAITS[:6])


def test_materials_are_known_again_by_another_measurement_of_them(model: TraitModel) -> None:
    posterior = model.posterior(curves("sgd"))
    assert posterior.argmax(axis=1).tolist() == [trait_index(name) for name in SCENE]
    np.testing.assert_allclose(posterior.sum(axis=1), 1.0)


@pytest.mark.parametrize("scale", [0.05, 20.0])
def test_the_unit_of_the_radiances_does_not_matter(model: TraitModel, scale: float) -> None:
    found = model.posterior(scale * curves("sgd"))
    np.testing.assert_allclose(found, model.posterior(curves("sgd")), atol=0.02)


def test_the_order_of_the_materials_does_not_matter(model: TraitModel) -> None:
    found = model.posterior(curves("sgd")[::-1])
    np.testing.assert_allclose(found[::-1], model.posterior(curves("sgd")), atol=1e-12)


def test_a_labelled_curve_itself_is_certain() -> None:
    found = trait_model(THETA_H).posterior(curves("sgd"))
    assert found.max(axis=1).min() > 0.9


def test_what_nobody_labelled_is_less_certain_than_what_somebody_did(model: TraitModel) -> None:
    known, kin = (m.posterior(curves("sgd")).max(axis=1).mean() for m in (model, model.without(SCENE)))
    assert kin < known
    assert not set(SCENE) & set(model.without(SCENE).name)


def fits_of(rows: list[int], n_pixels: int = 30) -> PixelFits:
    """Pixels of one material each, on their own: an atom a channel."""
    which = np.arange(n_pixels) % len(rows)
    dictionary = Dictionary("sgd", tuple(Atom("sgd", row, channel) for row in rows for channel in range(3)))
    atom = np.full((n_pixels, 3, 4), -1, np.int16)
    atom[:, :, 0] = 3 * which[:, None] + np.arange(3)
    normals = np.tile([0.0, 0.0, 1.0], (n_pixels, 1))
    return PixelFits(
        normals=normals,
        covariance=np.zeros((n_pixels, 3)),
        reduced_chi2=np.ones(n_pixels),
        loss=np.ones(n_pixels),
        atom=atom,
        coefficient=np.where(atom >= 0, 1.0, 0.0),
        flags=np.zeros(n_pixels, np.uint8),
        theta_h_range=np.tile(np.deg2rad([1.0, 60.0]), (n_pixels, 1)),
        dictionary=dictionary,
    )


def test_pixels_that_stand_on_their_own_are_pooled_by_their_curves() -> None:
    names = [str(name) for name in published("sgd")["name"]]
    rows = [names.index(name) for name in ("green-fabric", "blue-acrylic")]
    traits = pixel_traits(fits_of(rows))
    truth = [TRAITS.index("fabric"), TRAITS.index("acrylic")]
    assert traits.leading.tolist() == [truth[i % 2] for i in range(30)]
    assert traits.confidence.min() > 0.8
    np.testing.assert_allclose(sum(traits.grouped().values()), 1.0 - traits.share[:, -1])


def test_a_material_that_leads_in_no_pixel_counts_all_the_same() -> None:
    curve = np.stack([np.full((3, len(NODES)), 0.4), np.full((3, len(NODES)), 0.1)])
    fits = fits_of([0])
    atom = np.full_like(fits.atom, -1)
    atom[..., 0], atom[..., 1] = np.arange(3), 3 + np.arange(3)
    both = replace(fits, atom=atom, coefficient=np.where(atom >= 0, 0.5, 0.0), dictionary=Palette(curve).dictionary)
    np.testing.assert_allclose(pixel_traits(both).share.sum(axis=1), 1.0)


def test_a_pixel_that_was_not_solved_has_no_trait() -> None:
    fits = fits_of([0, 5])
    fits.normals[3] = np.nan
    traits = pixel_traits(fits)
    assert traits.leading[3] == -1
    assert np.isnan(traits.share[3]).all()
    assert (np.delete(traits.leading, 3) >= 0).all()


def test_without_a_solved_pixel_there_is_nothing_to_tell() -> None:
    fits = fits_of([0])
    fits.normals[:] = np.nan
    with pytest.raises(ValueError, match="no pixel is solved"):
        pixel_traits(fits, trait_model(THETA_H))


def test_the_parametric_dictionary_will_do_too() -> None:
    fits = fits_of([0])
    lambert = next(i for i, atom in enumerate(parametric().atoms) if atom.kind == "lambert")
    atom = np.where(fits.atom >= 0, lambert, -1).astype(np.int16)
    plain = PixelFits(**{**vars_of(fits), "atom": atom, "dictionary": parametric()})
    assert isinstance(pixel_traits(plain), Traits)


def vars_of(fits: PixelFits) -> dict:
    return {name: getattr(fits, name) for name in fits.__dataclass_fields__}
