import os
from pathlib import Path

import numpy as np
import pytest

from analysis.reflectance.dictionary import (
    N_NODES,
    Atom,
    Dictionary,
    TabulatedAtom,
    by_name,
    from_published,
    parametric,
    published,
)
from analysis.reflectance.models import Cosines, cosines_from_angles

SHARED = Path(os.environ.get("HALFANGLE_SHARED_DATA", Path(__file__).parents[4] / "shared" / "data"))


@pytest.mark.parametrize("name", ["sgd", "abc"])
def test_the_embedded_table_has_a_row_for_each_of_the_hundred_materials(name: str):
    assert len(published(name)) == 100
    assert len(by_name(name).atoms) == 300


@pytest.mark.parametrize("name", ["sgd", "abc"])
def test_the_embedded_table_is_the_shared_one_number_by_number(name: str):
    path = SHARED / f"merl_{name}.csv"
    if not path.exists():
        pytest.skip(f"{path} is not there: set HALFANGLE_SHARED_DATA to the folder with the published tables")
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    header, *rows = (line.split(",") for line in lines)
    table = published(name)
    for ours, fields in zip(table, rows, strict=True):
        theirs = dict(zip(header, fields, strict=True))
        for column in table.dtype.names or ():
            value = ours[column]
            assert value == (theirs[column] if isinstance(value, str) else float(theirs[column])), (fields[0], column)


def test_an_unknown_dictionary_is_refused_with_the_ones_there_are():
    with pytest.raises(
        ValueError, match="'merl', and there is no such file; built in are 'parametric', 'lambert', 'sgd'"
    ):
        by_name("merl")


def test_a_published_fit_is_finite_where_light_or_view_is_along_the_normal():
    """At theta_h = theta_d and phi_d = 0 or pi, where rounding takes the cosine beyond 1."""
    theta = np.linspace(0.01, 0.7, 500)
    for phi_d in (0.0, np.pi):
        cosines, above = cosines_from_angles(theta, theta, np.full(1, phi_d))
        assert above.all()
        for table in ("sgd", "abc"):
            assert np.isfinite(from_published(table).atoms[0].evaluate(cosines)).all()


def test_the_default_dictionary_has_a_diffuse_atom_and_lobes_of_every_width():
    atoms = by_name("parametric").atoms
    assert atoms[0].model == "lambert"
    assert len({atom.a for atom in atoms if atom.model == "lobe"}) == 14
    assert len(set(atoms)) == len(atoms)


def test_the_slice_table_times_its_scale_is_the_dictionary_on_the_slice():
    table = parametric().slice_table()
    c = 1.0 - np.linspace(0.0, 1.0, N_NODES) ** 2
    np.testing.assert_allclose(
        table.value * table.scale, parametric().evaluate(Cosines.on_slice(np.arccos(c))), rtol=1e-5, atol=1e-12
    )


def test_every_column_of_the_slice_table_weighs_alike():
    value = parametric().slice_table().value.astype(np.float64)
    np.testing.assert_allclose(np.sqrt(np.mean(value**2, axis=0)), 1.0, rtol=1e-5)


def test_the_slice_table_holds_the_slope_of_the_curves_over_cos_theta_h():
    """Against finite differences of the models themselves, on a tenth of the step of the table."""
    table = parametric().slice_table()
    node = np.arange(20, N_NODES - 20)
    t, step = node / (N_NODES - 1), 0.1 / (N_NODES - 1)
    low, high = 1.0 - (t + step) ** 2, 1.0 - (t - step) ** 2
    curve = {c: parametric().evaluate(Cosines.on_slice(np.arccos(x))) for c, x in (("low", low), ("high", high))}
    slope = (curve["high"] - curve["low"]) / (high - low)[:, None] / table.scale
    largest = np.maximum(np.abs(slope).max(axis=0), 1e-6)
    np.testing.assert_allclose(table.derivative[node] / largest, slope / largest, atol=0.02)


THETA_H, THETA_D = np.deg2rad([0.0, 0.5, 2.0, 10.0, 40.0, 80.0]), np.deg2rad([0.0, 20.0, 75.0])


@pytest.fixture
def tabulated() -> TabulatedAtom:
    value = np.random.default_rng(4).uniform(0.1, 5.0, (len(THETA_H), len(THETA_D)))
    return TabulatedAtom("velvet", THETA_H, THETA_D, value, channel=1)


def cosines(theta_h: object, theta_d: object) -> Cosines:
    """Cosines of angles in radians, light and view in the plane across the half vector's tilt."""
    h, d = np.broadcast_arrays(np.asarray(theta_h, float), np.asarray(theta_d, float))
    across = np.cos(h) * np.cos(d)
    return Cosines(np.cos(h), np.cos(d), across, across)


def test_a_tabulated_atom_is_exact_on_its_nodes(tabulated: TabulatedAtom):
    value = tabulated.evaluate(cosines(THETA_H[:, None], THETA_D[None, :]))
    np.testing.assert_allclose(value, tabulated.value, rtol=1e-12)


def test_a_tabulated_atom_is_linear_in_t_and_theta_d_between_its_nodes(tabulated: TabulatedAtom):
    t = np.sqrt(1.0 - np.cos(THETA_H))
    between = np.arccos(1.0 - (0.25 * t[2] + 0.75 * t[3]) ** 2)
    value = tabulated.evaluate(cosines(between, 0.5 * (THETA_D[1] + THETA_D[2])))
    corners = tabulated.value[2:4, 1:3]
    np.testing.assert_allclose(value, np.array([0.25, 0.75]) @ corners @ np.array([0.5, 0.5]), rtol=1e-9)


def test_a_tabulated_atom_stays_constant_beyond_its_table(tabulated: TabulatedAtom):
    value = tabulated.evaluate(cosines(np.deg2rad([80.0, 88.0]), np.deg2rad([75.0, 89.0])))
    np.testing.assert_allclose(value, tabulated.value[-1, -1], rtol=1e-12)


def test_a_table_of_one_difference_angle_does_not_depend_on_it():
    atom = TabulatedAtom("flat", THETA_H, np.zeros(1), np.arange(1.0, 7.0)[:, None])
    value = atom.evaluate(cosines(THETA_H, np.deg2rad(60.0)))
    np.testing.assert_allclose(value, np.arange(1.0, 7.0), rtol=1e-12)


def test_a_fine_table_of_a_model_is_the_model():
    theta_h, theta_d = np.deg2rad(np.linspace(0.0, 80.0, 400)), np.deg2rad(np.linspace(0.0, 80.0, 200))
    lobe = Atom("lobe", 0.3, 2.0)
    atom = TabulatedAtom("lobe", theta_h, theta_d, lobe.evaluate(cosines(theta_h[:, None], theta_d[None, :])))
    here = cosines(np.deg2rad([0.7, 12.3, 40.1]), np.deg2rad([3.3, 20.2, 50.9]))
    np.testing.assert_allclose(atom.evaluate(here), lobe.evaluate(here), rtol=1e-3)


def test_tables_and_models_stand_in_one_dictionary(tabulated: TabulatedAtom):
    mixed = Dictionary("palette", (*parametric().atoms, tabulated))
    here = Cosines.on_slice(np.deg2rad([0.0, 5.0, 60.0]))
    value = mixed.evaluate(here)
    np.testing.assert_array_equal(value[:, :-1], parametric().evaluate(here))
    np.testing.assert_array_equal(value[:, -1], tabulated.evaluate(here))
    table = mixed.slice_table()
    assert mixed.slice_table() is table
    assert np.isfinite(table.derivative).all()
    on_slice = tabulated.evaluate(Cosines.on_slice(np.arccos(1.0 - np.linspace(0.0, 1.0, N_NODES) ** 2)))
    np.testing.assert_allclose(table.value[:, -1] * table.scale[-1], on_slice, rtol=1e-5)


def test_every_atom_says_of_which_kind_it_is_and_which_material(tabulated: TabulatedAtom):
    kinds = {atom.name: atom.kind for atom in (*parametric().atoms, tabulated)}
    assert (kinds["lambert"], kinds["rim"], kinds["lobe"], kinds["velvet"]) == (
        "lambert",
        "diffuse",
        "lobe",
        "material",
    )
    assert tabulated.label == "velvet / green"
    assert [(atom.kind, atom.name) for atom in from_published("abc").atoms[:3]] == [("material", "alum-bronze")] * 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"theta_h": THETA_H[::-1]}, "theta_h must be finite and ascending"),
        ({"theta_d": np.deg2rad([0.0, 20.0, 95.0])}, "theta_d goes from 0 to 1.658 rad"),
        ({"theta_d": np.zeros(0)}, r"theta_d has shape \(0,\)"),
        ({"value": np.ones((3, 6))}, r"value has shape \(3, 6\); must end in \(6, 3\)"),
        ({"value": np.full((6, 3), np.nan)}, "value is negative or not finite in 18 of 18 cells"),
        ({"value": np.full((6, 3), -1e-9)}, "value is negative or not finite in 18 of 18 cells"),
    ],
)
def test_a_table_that_is_no_brdf_is_refused_with_its_name_and_the_reason(change: dict, message: str):
    arguments = {"theta_h": THETA_H, "theta_d": THETA_D, "value": np.ones((6, 3)), **change}
    with pytest.raises(ValueError, match=f"table of 'velvet / red' cannot be used: .*{message}"):
        TabulatedAtom("velvet", **arguments)
