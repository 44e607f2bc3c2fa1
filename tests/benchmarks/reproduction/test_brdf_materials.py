from pathlib import Path

import numpy as np
import pytest

from analysis.reflectance.atoms import published
from analysis.reflectance.categories import categories
from analysis.reflectance.merl import cell_angles
from benchmarks.reproduction.brdf_materials import (
    MIN_MATERIALS,
    TABLES,
    Angles,
    Bank,
    MeasuredBrdf,
    PublishedBrdf,
    collections,
    fitted,
    measured,
)
from benchmarks.reproduction.experiment import Request, SkippedError
from tests.merl_files import write_materials


def test_every_material_of_both_tables_has_a_category():
    for table in ("sgd", "abc"):
        assert {str(name) for name in published(table)["name"]} == set(categories())


@pytest.mark.parametrize("tables", TABLES)
def test_no_material_meets_itself_in_its_dictionary(tables: tuple[str, str]):
    collection = fitted(*tables)
    assert collection.is_stand_in
    for material, dictionary in collection.trials():
        assert material.name not in {atom.name for atom in dictionary.atoms}
        assert len(dictionary.atoms) == 3 * 99
        assert material.brdf.table != dictionary.atoms[0].model


def test_what_a_bank_holds_is_what_dictionary_and_material_say():
    collection = fitted("sgd", "abc")
    places = {"one": Angles.of(np.array([0.1, 0.4]), 0.2, 0.7), "other": Angles.of(np.array([0.3]))}
    bank, material = Bank(collection, places), collection.tested[7]
    np.testing.assert_array_equal(bank.truth(material.name, "other"), material.brdf.at(places["other"]))
    assert bank.atoms("one").shape == (2, 300)
    without = bank.atoms("one", material.name)
    assert without.shape == (2, 297)
    brdf = PublishedBrdf("abc", 0)
    np.testing.assert_allclose(without[:, :3], brdf.at(places["one"]))


def test_angles_know_light_and_view():
    angles = Angles.of(np.deg2rad(30.0), np.deg2rad(20.0), np.deg2rad([0.0, 90.0, 180.0]))
    n_dot_l, n_dot_v = angles.n_dot_l_and_v
    # In the plane of the normal the angles add up; beside it light and view are alike.
    np.testing.assert_allclose(n_dot_l[[0, 2]], np.cos(np.deg2rad([50.0, 10.0])))
    np.testing.assert_allclose(n_dot_v[[0, 2]], np.cos(np.deg2rad([10.0, 50.0])))
    assert n_dot_l[1] == pytest.approx(n_dot_v[1])


def test_few_materials_are_spread_over_the_names_and_take_those_asked_for(tmp_path: Path):
    (collection,) = collections(Request(tmp_path, quick=True, seed=0), 5, ("teflon",))
    names = [material.name for material in collection.tested]
    assert "teflon" in names
    assert 5 <= len(names) <= 6
    assert len(collection.known) == 100


def test_a_folder_with_too_few_files_is_skipped_with_the_reason(tmp_path: Path):
    with pytest.raises(SkippedError, match=rf"holds 0 \.binary files; at least {MIN_MATERIALS} are needed"):
        collections(Request(tmp_path, quick=True, seed=0, merl=tmp_path))


def test_a_measured_material_is_looked_up_in_its_cells(tmp_path: Path):
    folder = write_materials(tmp_path / "merl", teflon=92)
    theta_h, theta_d, phi_d = cell_angles()
    inside = Angles.of(theta_h[[3, 40, 60]], theta_d[[2, 30, 10]], phi_d[[5, 100, 179]])
    brdf = MeasuredBrdf(folder / "teflon.binary")
    np.testing.assert_allclose(brdf.at(inside), PublishedBrdf("sgd", 92).at(inside), rtol=1e-9)
    # Reciprocity: half a turn of phi_d exchanges light and view.
    turned = Angles(inside.theta_h, inside.theta_d, inside.phi_d + np.pi)
    np.testing.assert_array_equal(brdf.at(turned), brdf.at(inside))
    below = Angles.of(np.deg2rad(85.0), np.deg2rad(80.0), 0.0)
    assert np.isfinite(brdf.at(below)).all()
    assert (brdf.at(below) >= 0.0).all()


@pytest.mark.slow
def test_measured_files_are_left_out_in_turn(tmp_path: Path):
    names = [str(name) for name in published("sgd")["name"][: 9 * 10 : 10]]
    rows = {name.replace("-", "_"): 10 * i for i, name in enumerate(names)}
    collection = measured(write_materials(tmp_path / "merl", **rows))
    assert not collection.is_stand_in
    for material, dictionary in collection.trials():
        assert len(dictionary.atoms) == 3 * 8
        assert material.name not in {atom.name for atom in dictionary.atoms}
