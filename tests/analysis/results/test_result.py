from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.evaluation.scoring import score, truth_error
from analysis.palette.materials import group_materials
from analysis.pixels.fits import PixelFits
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.reflectance.dictionary import AnyAtom, Atom, Dictionary, TabulatedAtom
from analysis.reflectance.models import Cosines
from analysis.registration.stack import Stack
from analysis.registration.stack_file import write_stack
from analysis.results import result_file
from analysis.results.result import FLAG_NAMES, MODEL_NAMES, Result, diffuse_albedo, model_used, result_of
from analysis.results.result_file import read_result, write_result
from analysis.stages import Stage
from instrument.files.validation import InvalidInputError


@pytest.fixture(scope="module")
def reconstruction(stack: Stack) -> Reconstruction:
    """Of pixels on their own, whose atoms are the parametric dictionary's."""
    return reconstruct(stack, Options(palette="off"))


@pytest.fixture(scope="module")
def result(reconstruction: Reconstruction) -> Result:
    stages = [Stage("depth", 0.5, 100.0)]
    return result_of(reconstruction, stages, score(reconstruction, 2), truth_error(reconstruction))


@pytest.fixture
def path(result: Result, tmp_path: Path) -> Path:
    path = tmp_path / "sample.result.h5"
    write_result(path, result)
    return path


def test_a_result_reads_back_as_it_was_written(result: Result, path: Path):
    back = read_result(path)
    np.testing.assert_allclose(back.normals, result.normals, atol=1e-6)
    np.testing.assert_allclose(back.depth, result.depth, atol=1e-6)
    np.testing.assert_allclose(back.depth_sigma, result.depth_sigma, rtol=1e-5)
    np.testing.assert_allclose(back.truth_error, result.truth_error, rtol=1e-4)
    np.testing.assert_allclose(back.fits.coefficient, result.fits.coefficient, rtol=1e-6)
    np.testing.assert_array_equal(back.fits.atom, result.fits.atom)
    np.testing.assert_array_equal(back.fits.flags, result.fits.flags)
    assert back.fits.dictionary == result.fits.dictionary
    assert (back.grid, back.choices, back.stages, back.summary) == (
        result.grid,
        result.choices,
        result.stages,
        result.summary,
    )


def test_the_brdf_survives_the_file(result: Result, path: Path):
    cosines = Cosines.on_slice(np.broadcast_to(np.deg2rad([5.0, 30.0, 60.0]), (576, 3)))
    np.testing.assert_allclose(read_result(path).fits.brdf(cosines), result.fits.brdf(cosines), rtol=1e-5)


def test_a_result_is_never_overwritten(result: Result, path: Path):
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        write_result(path, result)
    assert path.read_bytes() == before


def test_rendering_a_view_of_the_stack_gives_its_radiance_within_the_noise(reconstruction: Reconstruction, path: Path):
    stack = reconstruction.stack
    rendered = read_result(path).render(stack.camera_position[7], stack.light_position[7], stack.light_power[7])
    sigma = np.hypot(np.sqrt(stack.variance[7]), reconstruction.noise.relative * stack.radiance[7])
    deviation = (rendered - stack.radiance[7]) / sigma
    assert np.sqrt(np.mean(deviation**2)) < 2.0
    assert np.percentile(np.abs(deviation), 99) < 5.0


def test_twice_the_power_renders_twice_the_radiance(result: Result):
    camera = np.array([20.0, 30.0, 340.0])
    np.testing.assert_allclose(result.render(camera, camera, 2.0), 2.0 * result.render(camera, camera), rtol=1e-9)


def test_a_light_behind_the_sample_renders_black(result: Result):
    assert not result.render(np.array([0.0, 0.0, 300.0]), np.array([0.0, 0.0, -300.0])).any()


def test_the_maps_agree_with_each_other(path: Path):
    with h5py.File(path) as file:
        maps = file["/entry/result"]
        solved = np.isfinite(maps["normals"][..., 0])
        np.testing.assert_array_equal(maps["model"][...] > 0, solved)
        np.testing.assert_array_equal(maps["material"][...] >= 0, solved)
        assert list(maps["model"].attrs["names"]) == list(MODEL_NAMES)
        assert maps["model"][...].max() < len(MODEL_NAMES)
        assert set(np.unique(maps["flags"][...])) <= {0, *FLAG_NAMES}
        assert maps["depth"].attrs["units"] == "mm"
        albedo = maps["diffuse_albedo"][...]
    np.testing.assert_array_equal(np.isfinite(albedo[..., 0]), solved)
    assert np.nanmin(albedo) > 0.0


def test_the_diffuse_albedo_of_the_matte_stripe_is_its_albedo(reconstruction: Reconstruction):
    matte = reconstruction.stack.truth.material.ravel() == 0
    albedo = np.median(diffuse_albedo(reconstruction.fits)[matte], axis=0)
    np.testing.assert_allclose(albedo, [0.5, 0.3, 0.2], rtol=0.02)


FOUR = (Atom("lambert"), Atom("cosine"), Atom("lobe", 0.1, 2.0), Atom("lobe", 0.3, 2.0))


def pixels(*atoms: tuple[int, ...], known: tuple[AnyAtom, ...] = FOUR) -> PixelFits:
    """Return fits of one channel whose pixels use these of the `known` atoms."""
    dictionary = Dictionary("few", known)
    atom = np.full((len(atoms), 1, 6), -1, np.int16)
    for p, used in enumerate(atoms):
        atom[p, 0, : len(used)] = used
    n = len(atoms)
    return PixelFits(
        normals=np.tile([0.0, 0.0, 1.0], (n, 1)),
        covariance=np.ones((n, 3)),
        reduced_chi2=np.ones(n),
        loss=np.ones(n),
        atom=atom,
        coefficient=np.where(atom >= 0, 0.5, 0.0),
        flags=np.zeros(n, np.uint8),
        theta_h_range=np.tile(np.deg2rad([2.0, 60.0]), (n, 1)),
        dictionary=dictionary,
    )


def test_the_model_is_named_after_the_atoms_that_a_pixel_uses():
    fits = pixels((0,), (1,), (0, 1), (2,), (0, 2), (2, 3))
    fits.normals[1] = np.nan
    names = [MODEL_NAMES[i] for i in model_used(fits)]
    assert names == ["lambert", "unsolved", "diffuse", "one lobe", "one lobe", "mixture"]


def tables(rng: np.random.Generator) -> tuple[TabulatedAtom, ...]:
    """Tables of two materials of two channels each, on one grid, and one of a coarser grid."""
    fine = np.deg2rad(np.linspace(0.0, 89.0, 30)), np.deg2rad(np.linspace(0.0, 80.0, 9))
    coarse = np.deg2rad([0.0, 30.0, 60.0]), np.zeros(1)

    def made(name: str, grid: tuple[np.ndarray, np.ndarray], channel: int) -> TabulatedAtom:
        value = rng.uniform(0.01, 900.0, (len(grid[0]), len(grid[1]))).astype(np.float32)
        return TabulatedAtom(name, *grid, value.astype(np.float64), channel)

    return (*(made(name, fine, c) for name in ("foil", "card") for c in (0, 1)), made("felt", coarse, 0))


TABLES = tables(np.random.default_rng(1))


def test_a_pixel_of_tables_is_of_one_material_however_many_channels_it_uses():
    lambert, foil_red, foil_green, card_red, lobe = 0, 4, 5, 6, 2
    used = (
        (foil_red,),
        (foil_red, foil_green),
        (foil_red, card_red),
        (lambert, foil_red),
        (lobe, foil_red),
        (lambert,),
    )
    names = [MODEL_NAMES[i] for i in model_used(pixels(*used, known=(*FOUR, *TABLES)))]
    assert names == ["material", "material", "mixture of materials", "material", "material", "lambert"]


def test_a_pixel_of_published_fits_is_of_a_material_too():
    known = tuple(Atom("sgd", row, channel) for row in range(2) for channel in range(3))
    assert [MODEL_NAMES[i] for i in model_used(pixels((0, 1, 2), (0, 3), known=known))] == [
        "material",
        "mixture of materials",
    ]


@pytest.fixture
def tabulated(result: Result) -> Result:
    """The result with every other pixel made of tables."""
    atoms = (*result.fits.dictionary.atoms, *TABLES)
    atom = result.fits.atom.copy()
    atom[::2, :, 0] = len(atoms) - 1 - np.arange(atom[::2].shape[0])[:, None] % len(TABLES)
    return replace(result, fits=replace(result.fits, atom=atom, dictionary=Dictionary("palette", atoms)))


@pytest.fixture
def tabulated_path(tabulated: Result, tmp_path: Path) -> Path:
    path = tmp_path / "tables.result.h5"
    write_result(path, tabulated)
    return path


@pytest.mark.parametrize("kind", ["result", "tabulated"])
def test_the_room_that_is_taken_for_a_result_holds_one_that_does_not_pack(
    request: pytest.FixtureRequest, tmp_path: Path, kind: str
):
    made: Result = request.getfixturevalue(kind)
    rng = np.random.default_rng(0)

    def noise(values: np.ndarray) -> np.ndarray:
        return rng.uniform(0.5, 1.0, values.shape)

    fits = replace(made.fits, coefficient=noise(made.fits.coefficient), reduced_chi2=noise(made.fits.reduced_chi2))
    result = replace(made, fits=replace(fits, covariance=noise(fits.covariance)), depth=noise(made.depth))
    # Several sizes, for HDF5 cuts maps into chunks that go beyond them.
    for n in (1, 2, 3):
        height = made.grid.height // n
        first = np.arange(height * made.grid.width)
        maps = {name: getattr(result, name)[:height] for name in ("depth", "depth_sigma")}
        error = None if result.truth_error is None else result.truth_error[:height]
        part = replace(
            result, fits=result.fits.select(first), grid=replace(made.grid, height=height), truth_error=error, **maps
        )
        write_result(tmp_path / f"{n}.result.h5", part)
        assert (tmp_path / f"{n}.result.h5").stat().st_size <= result_file._most_bytes(part)


def test_tables_read_back_exactly(tabulated: Result, tabulated_path: Path):
    back = read_result(tabulated_path).fits.dictionary
    assert back.name == "palette"
    assert back.atoms[: -len(TABLES)] == tabulated.fits.dictionary.atoms[: -len(TABLES)]
    for ours, theirs in zip(back.atoms[-len(TABLES) :], TABLES, strict=True):
        assert isinstance(ours, TabulatedAtom)
        assert (ours.name, ours.channel) == (theirs.name, theirs.channel)
        for name in ("theta_h", "theta_d", "value"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


def test_a_brdf_of_tables_survives_the_file_away_from_the_slice(tabulated: Result, tabulated_path: Path):
    cosines = Cosines(*(np.full((576, 2), c) for c in (0.9, 0.8, 0.75, 0.7)))
    np.testing.assert_allclose(read_result(tabulated_path).fits.brdf(cosines), tabulated.fits.brdf(cosines), rtol=1e-5)


def test_a_file_of_the_first_version_is_read(path: Path, result: Result):
    """It had no tables; nothing else has changed."""
    with h5py.File(path, "r+") as file:
        assert not [name for name in file["/entry/brdf"] if name.startswith("tables")]
        file["/entry"].attrs["halfangle_schema"] = "1.0"
    assert read_result(path).fits.dictionary == result.fits.dictionary


def test_the_format_page_names_every_dataset_of_a_result(tabulated_path: Path):
    page, names = (Path(__file__).parents[3] / "docs" / "format.md").read_text(encoding="utf-8"), []
    with h5py.File(tabulated_path) as file:
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    last = {name.split("/")[-1] for name in names} - {"program_version"}
    assert [name for name in last if f"{name}`" not in page] == []


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("value", lambda v: v[:, :-1], "must end in (30, 9)"),
        ("value", lambda v: v[0], "must be (tables, theta_h, theta_d)"),
        ("value", lambda v: np.where(v > 800.0, np.nan, v), "negative or not finite"),
        ("value", lambda v: -v, "negative or not finite in 1080 of 1080 cells"),
        ("theta_h", lambda v: v[::-1], "ascending"),
        ("theta_d", lambda v: v + 1.0, "must stay within 0 to pi / 2"),
        ("name", lambda v: v[:2], "must be one for each of the 4 tables"),
        ("channel", lambda v: v[:2], "must be one for each of the 4 tables"),
        ("channel", lambda v: None, "missing"),
    ],
)
def test_a_damaged_table_is_refused_by_the_name_of_its_dataset(tabulated_path: Path, name: str, change, message: str):
    where = f"/entry/brdf/tables_0/{name}"
    with h5py.File(tabulated_path, "r+") as file:
        damaged = change(file[where][...])
        del file[where]
        if damaged is not None:
            file[where] = damaged
    assert [message in problem.what for problem in refusal(tabulated_path).problems if problem.where == where] == [True]


def test_all_damage_to_the_tables_is_told_at_once(tabulated_path: Path):
    with h5py.File(tabulated_path, "r+") as file:
        file["/entry/brdf/tables_0/theta_h"][0] = np.nan
        del file["/entry/brdf/tables_1"]
        file["/entry/brdf/atom_model"][0] = "velvet"
        file["/entry/brdf/atom_parameters"][-5] = (0, 7)
    where = {problem.where for problem in refusal(tabulated_path).problems}
    assert {"/entry/brdf/atom_model", "/entry/brdf/tables_0/theta_h", "/entry/brdf/tables_1/value"} <= where


def test_an_atom_that_is_no_table_of_its_grid_is_told(tabulated_path: Path):
    with h5py.File(tabulated_path, "r+") as file:
        file["/entry/brdf/atom_parameters"][-5] = (0, 7)
    problem = refusal(tabulated_path).problems[0]
    assert (problem.where, "holds 4" in problem.what) == ("/entry/brdf/atom_parameters", True)


def test_materials_are_numbered_by_size_and_unsolved_pixels_are_in_none():
    fits = pixels(*[(0,)] * 30, *[(2,)] * 60)
    fits.normals[0] = np.nan
    groups = group_materials(fits)
    assert groups[0] == -1
    assert set(groups[1:30]) == {1}
    assert set(groups[30:]) == {0}


def test_one_material_is_one_group():
    assert set(group_materials(pixels(*[(0, 2)] * 50))) == {0}


def test_a_sample_without_a_solved_pixel_has_no_materials():
    fits = pixels((0,), (2,))
    fits.normals[:] = np.nan
    assert group_materials(fits).tolist() == [-1, -1]


def test_no_group_spans_two_stripes_of_the_sample(reconstruction: Reconstruction):
    groups, truth = group_materials(reconstruction.fits), reconstruction.stack.truth.material.ravel()
    assert groups.max() >= 2
    for g in range(groups.max() + 1):
        assert np.bincount(truth[groups == g]).max() > 0.95 * np.count_nonzero(groups == g)


def refusal(path: Path) -> InvalidInputError:
    with pytest.raises(InvalidInputError, match="cannot be read as a result") as caught:
        read_result(path)
    assert str(path) in str(caught.value)
    return caught.value


def test_a_stack_is_not_taken_for_a_result(reconstruction: Reconstruction, tmp_path: Path):
    path = tmp_path / "sample.stack.h5"
    write_stack(path, reconstruction.stack)
    missing = {p.where for p in refusal(path).problems}
    assert {"/entry/result/normals", "/entry/brdf/atom"} <= missing


def test_a_missing_or_foreign_file_is_told(tmp_path: Path):
    assert refusal(tmp_path / "nowhere.result.h5").problems[0].what == "there is no such file"
    (tmp_path / "notes.result.h5").write_text("not HDF5")
    assert "this is not an HDF5 file" in refusal(tmp_path / "notes.result.h5").problems[0].what


def test_everything_that_is_missing_is_told_at_once(path: Path):
    with h5py.File(path, "r+") as file:
        del file["/entry/result/depth"], file["/entry/brdf/coefficient"]
    assert {p.where for p in refusal(path).problems} == {"/entry/result/depth", "/entry/brdf/coefficient"}


def test_an_atom_that_this_version_does_not_know_is_named(path: Path):
    with h5py.File(path, "r+") as file:
        file["/entry/brdf/atom_model"][0] = "velvet"
    assert "velvet" in refusal(path).problems[0].what


def test_an_atom_beyond_the_list_is_told(path: Path):
    with h5py.File(path, "r+") as file:
        file["/entry/brdf/atom"][0, 0, 0, 0] = 999
    assert "points beyond" in refusal(path).problems[0].what
