"""`halfangle dictionary`, run as a user runs it, on files of MERL and RGL made from fits and formulas."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.reflectance import dictionary_file
from analysis.reflectance.atoms import TabulatedAtom, published
from analysis.reflectance.dictionary import by_name
from analysis.reflectance.dictionary_file import MaterialTables, read_dictionary, write_dictionary
from analysis.reflectance.merl import cell_angles
from analysis.reflectance.models import cosines_from_angles
from analysis.registration.stack_file import write_stack
from analysis.results.result_file import read_result
from cli.main import main
from instrument.files.validation import InvalidInputError
from tests.merl_files import write_materials
from tests.rgl_files import lambert, rgl_bytes, rgl_fields, write_rgl
from tests.synthetic import make_stack

ROWS = {"alum_bronze": 0, "aluminium": 2, "blue_fabric": 20}
NAMES = ("alum-bronze", "aluminium", "blue-fabric")


def run(*arguments: str | Path) -> int:
    """Run `halfangle` and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@pytest.fixture(scope="module")
def merl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_materials(tmp_path_factory.mktemp("merl"), **ROWS)


@pytest.fixture(scope="module")
def built(merl: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("built")
    table = folder / "categories.csv"
    table.write_text("name,category,note\naluminium,metal,\nblue-fabric,fabric,soft\nnickel,metal,\n")
    built = folder / "three.dictionary.h5"
    assert run("dictionary", "build", merl, "-o", built, "--categories", table, "-q") == 0
    assert sorted(f.name for f in folder.iterdir()) == ["categories.csv", "three.dictionary.h5"]
    return built


@pytest.fixture(scope="module")
def tables(built: Path) -> MaterialTables:
    return read_dictionary(built)


def test_each_channel_of_each_material_becomes_an_atom(tables: MaterialTables) -> None:
    assert [(atom.name, atom.channel) for atom in tables.atoms] == [(name, c) for name in NAMES for c in range(3)]


def test_materials_keep_their_category_and_where_they_come_from(tables: MaterialTables, merl: Path) -> None:
    assert [(m.name, m.category) for m in tables.materials] == list(zip(NAMES, ("", "metal", "fabric"), strict=True))
    for material in tables.materials:
        assert material.sha256 == hashlib.sha256((merl / material.file).read_bytes()).hexdigest()
    assert tables.program_version


def test_an_atom_is_the_average_over_the_measured_phi_d(tables: MaterialTables) -> None:
    theta_h, theta_d, phi_d = cell_angles()
    i_h, i_d = np.array([0, 10, 40, 70]), np.array([0, 30, 60])
    cosines, above = cosines_from_angles(theta_h[i_h, None, None], theta_d[i_d, None], phi_d)
    atoms = [atom for atom in by_name("sgd").atoms if atom.name == published("sgd")["name"][2]]
    for ours, model in zip(tables.atoms[3:6], atoms, strict=True):
        expected = np.mean(model.evaluate(cosines), axis=-1, where=above)
        np.testing.assert_allclose(ours.value[np.ix_(i_h, i_d)], expected, rtol=2e-4)


def test_cells_that_were_not_measured_are_filled_and_counted_as_such(tables: MaterialTables) -> None:
    assert tables.n_measured.shape == (9, 90, 90)
    assert tables.n_measured[:, 10, 10].tolist() == [180] * 9
    assert np.count_nonzero(tables.n_measured < 180) > 0
    assert all(np.isfinite(atom.value).all() for atom in tables.atoms)


def test_a_hundred_materials_would_take_a_few_megabytes(built: Path) -> None:
    assert built.stat().st_size / len(NAMES) < 0.1e6


def test_a_built_dictionary_is_listed_and_looked_at(built: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("dictionary", "list", built) == 0
    shown = capsys.readouterr().out
    assert "aluminium" in shown
    assert "metal" in shown
    assert run("dictionary", "info", built) == 0
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) == 10
    assert shown[1].startswith("alum-bronze / red")


def test_files_of_both_databases_make_one_dictionary(
    merl: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, built = tmp_path / "both", tmp_path / "both.dictionary.h5"
    folder.mkdir()
    shutil.copy(merl / "aluminium.binary", folder / "aluminium.binary")
    file = write_rgl(folder / "grey_card_rgb.BSDF", rgl_fields(lambert))
    (tmp_path / "categories.csv").write_text("name,category\ngrey_card,paper\n")
    assert run("dictionary", "build", folder, "-o", built, "--categories", tmp_path / "categories.csv", "-q") == 0
    assert "2 materials, 6 atoms" in capsys.readouterr().out
    tables = read_dictionary(built)
    assert [(m.name, m.category, m.file) for m in tables.materials] == [
        ("aluminium", "", "aluminium.binary"),
        ("grey_card", "paper", "grey_card_rgb.BSDF"),
    ]
    assert tables.materials[1].sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
    for atom, value in zip(tables.atoms[3:], (0.1, 0.2, 0.3), strict=True):
        np.testing.assert_allclose(atom.value, value, rtol=0.1)
        np.testing.assert_allclose(atom.value[:60, 0], value, rtol=0.03)
    assert 0.6 < tables.measured_share("grey_card") < 0.9
    assert run("dictionary", "list", built) == 0
    assert "grey_card" in capsys.readouterr().out


def test_a_name_that_is_neither_built_in_nor_a_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_stack(tmp_path / "area.stack.h5", make_stack(n_views=6, size=4))
    arguments = (tmp_path / "area.stack.h5", "-o", tmp_path / "r.h5", "--dictionary", "nickel")
    assert run("reconstruct", *arguments) == 2
    assert (
        "'nickel', and there is no such file; built in are 'parametric', 'lambert', 'sgd' and 'abc'"
        in capsys.readouterr().err
    )
    assert run("dictionary", "info", "nickel") == 2
    assert not (tmp_path / "r.h5").exists()


def test_reconstruct_takes_a_built_dictionary_and_its_result_carries_it(built: Path, tmp_path: Path) -> None:
    write_stack(tmp_path / "area.stack.h5", make_stack(n_views=30, size=8))
    output = tmp_path / "area.result.h5"
    how = ("--dictionary", built, "--accuracy", "draft", "--left-out", "0", "-q")
    assert run("reconstruct", tmp_path / "area.stack.h5", "-o", output, *how) == 0
    fits = read_result(output).fits
    assert fits.dictionary.name == built.name
    assert all(isinstance(atom, TabulatedAtom) for atom in fits.dictionary.atoms)
    assert np.isfinite(fits.normals).all()
    with h5py.File(output) as file:
        names = file["/entry/result/model"].attrs["names"]
        assert {names[i] for i in np.unique(file["/entry/result/model"])} <= {"material", "mixture of materials"}


@pytest.fixture
def folder(merl: Path, tmp_path: Path) -> Path:
    """A folder with one good file."""
    folder = tmp_path / "mine"
    folder.mkdir()
    shutil.copy(merl / "aluminium.binary", folder / "aluminium.binary")
    return folder


def cut(folder: Path) -> None:
    whole = (folder / "aluminium.binary").read_bytes()
    (folder / "cut.binary").write_bytes(whole[:-1000])


def foreign(folder: Path) -> None:
    (folder / "foreign.binary").write_bytes(np.array([45, 45, 90], "<i4").tobytes())


def twice(folder: Path) -> None:
    shutil.copy(folder / "aluminium.binary", folder / "Aluminium.BINARY")


def of_both_databases(folder: Path) -> None:
    shutil.copy(folder / "aluminium.binary", folder / "felt.binary")
    write_rgl(folder / "felt_rgb.bsdf", rgl_fields(n=5))


def cut_rgl(folder: Path) -> None:
    (folder / "felt_rgb.bsdf").write_bytes(rgl_bytes(rgl_fields(n=5))[:-2000])


def never_measured(folder: Path) -> None:
    fields = rgl_fields(n=5)
    fields["rgb"][..., ::2, :] = fields["rgb"][..., ::2] = 0.0
    write_rgl(folder / "felt_rgb.bsdf", fields)


def emptied(folder: Path) -> None:
    (folder / "aluminium.binary").rename(folder / "aluminium.bin")


def removed(folder: Path) -> None:
    shutil.rmtree(folder)


def all_of_them(folder: Path) -> None:
    cut(folder)
    cut_rgl(folder)
    foreign(folder)
    twice(folder)


@pytest.mark.parametrize(
    ("damage", "messages"),
    [
        (cut, ["cut.binary: has 34991012 bytes"]),
        (foreign, ["begins with the sizes (45, 45, 90)"]),
        (twice, ["are one material's name but for the case or ending; keep one"]),
        (of_both_databases, ["felt.binary and felt_rgb.bsdf are one material's name but for the case or ending"]),
        (cut_rgl, ["felt_rgb.bsdf: rgb would end at byte", "the file was cut short"]),
        (never_measured, ["felt_rgb.bsdf: no cell of red rests on measured values alone"]),
        (
            emptied,
            [
                "holds no .binary and no .bsdf file; MERL's files are called like alum-bronze.binary",
                "paper_white_rgb.bsdf",
            ],
        ),
        (removed, ["is no folder"]),
        (all_of_them, ["cut.binary", "felt_rgb.bsdf", "(45, 45, 90)", "but for the case"]),
    ],
)
def test_bad_files_are_told_together_with_code_2_and_nothing_is_written(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    damage: Callable[[Path], None],
    messages: list[str],
) -> None:
    damage(folder)
    before = sorted(folder.parent.iterdir())
    assert run("dictionary", "build", folder, "-o", folder.parent / "mine.dictionary.h5", "-q") == 2
    shown = capsys.readouterr().err
    assert [message for message in messages if message not in shown] == []
    assert sorted(folder.parent.iterdir()) == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("material,kind\n", "has no column category and name; the first line must read name,category"),
        ("name,category\nfelt,cloth\nfelt,fabric\n", ":3: felt stands in line 2 already"),
        ("name,category\n,cloth\n", ":2: has no name"),
        (None, "cannot be read"),
    ],
)
def test_bad_categories_are_told_by_line(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str | None, message: str
) -> None:
    table = folder.parent / "categories.csv"
    if text is not None:
        table.write_text(text)
    assert run("dictionary", "build", folder, "-o", folder.parent / "x.h5", "--categories", table, "-q") == 2
    assert message in capsys.readouterr().err
    assert not (folder.parent / "x.h5").exists()


def test_a_dictionary_is_not_overwritten(built: Path, merl: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = built.read_bytes()
    assert run("dictionary", "build", merl, "-o", built) == 2
    assert "exists and is not overwritten" in capsys.readouterr().err
    assert built.read_bytes() == before


def test_a_write_that_fails_leaves_nothing_behind(tables: MaterialTables, tmp_path: Path) -> None:
    first = tables.atoms[0]
    of_another_grid = TabulatedAtom("felt", first.theta_h, first.theta_d[:1], first.value[:, :1])
    with pytest.raises(ValueError, match="shape"):
        write_dictionary(tmp_path / "x.dictionary.h5", replace(tables, atoms=(first, of_another_grid)))
    assert list(tmp_path.iterdir()) == []


def refusal(path: Path) -> set[str]:
    with pytest.raises(InvalidInputError, match="cannot be read as a dictionary") as caught:
        read_dictionary(path)
    return {problem.where for problem in caught.value.problems}


def test_a_damaged_dictionary_is_refused_by_the_name_of_the_dataset(built: Path, tmp_path: Path) -> None:
    path = tmp_path / "damaged.dictionary.h5"
    shutil.copy(built, path)
    with h5py.File(path, "r+") as file:
        file["/entry/tables/value"][0, 0, 0] = np.nan
        file["/entry/tables/theta_h"][1] = 0.0
    assert refusal(path) == {"/entry/tables/value", "/entry/tables/theta_h"}
    with h5py.File(path, "r+") as file:
        del file["/entry/materials/category"], file["/entry/tables/n_measured"], file["/entry/tables/channel"]
    assert refusal(path) == {"/entry/materials/category", "/entry/tables/n_measured", "/entry/tables/channel"}


def test_materials_and_tables_that_disagree_are_refused(built: Path, tmp_path: Path) -> None:
    path = tmp_path / "damaged.dictionary.h5"
    shutil.copy(built, path)
    with h5py.File(path, "r+") as file:
        file["/entry/materials/name"][0] = "felt"
    assert refusal(path) == {"/entry/materials/name"}


def test_a_file_that_is_no_dictionary_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.h5").write_text("not HDF5")
    assert refusal(tmp_path / "notes.h5") == {str(tmp_path / "notes.h5")}
    write_stack(tmp_path / "area.stack.h5", make_stack(n_views=4, size=4))
    assert "/entry/materials/name" in refusal(tmp_path / "area.stack.h5")


def test_the_room_that_is_taken_for_a_dictionary_holds_it(tables: MaterialTables, built: Path) -> None:
    assert built.stat().st_size <= dictionary_file._most_bytes(tables)
