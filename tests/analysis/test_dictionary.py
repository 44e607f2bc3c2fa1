import os
from pathlib import Path

import numpy as np
import pytest

from analysis.dictionary import N_NODES, by_name, parametric, published
from analysis.reflectance import Cosines

SHARED = Path(os.environ.get("HALFANGLE_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data"))


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
    with pytest.raises(ValueError, match="dictionary is 'merl'; built in are 'parametric', 'sgd' and 'abc'"):
        by_name("merl")


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
