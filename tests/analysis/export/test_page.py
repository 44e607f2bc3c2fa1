"""The page that relights: what its data says, shaded without a browser, is what the result renders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.export.page.columns import MODEL_CODES
from analysis.export.page.page import relight, write_relighting_page
from analysis.export.page.texels import normal_plane
from analysis.reflectance.atoms import MODELS
from analysis.reflectance.dictionary import Dictionary, from_published, parametric
from analysis.registration.grid import Grid
from analysis.results.result import Result
from analysis.results.result_file import write_result
from instrument.files.validation import InvalidInputError
from tests.analysis.export.gltf_shading import psnr
from tests.analysis.export.own_atoms import result_of
from tests.analysis.export.page_reading import picture, read_page
from tests.analysis.export.scene import SIZE, atoms, small_result

Array = NDArray[np.float64]

PLACES = tuple(
    (np.array(camera), np.array(light))
    for camera, light in (
        ((0.0, 0.0, 50.0), (0.0, 0.0, 50.0)),
        ((0.0, 0.0, 50.0), (25.0, 15.0, 40.0)),
        ((-20.0, 5.0, 45.0), (35.0, 10.0, 30.0)),
    )
)


def rendered(result: Result, camera: Array, light: Array) -> Array:
    return result.render(camera, light).reshape(len(result.fits.normals), -1) * np.ones(3)


def test_palette_pixels_are_as_rendered(tmp_path: Path) -> None:
    result = small_result()
    write_relighting_page(tmp_path / "page.html", result)
    page = read_page(tmp_path / "page.html")
    for camera, light in PLACES:
        expected, found = rendered(result, camera, light), picture(page, camera, light)
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
        assert psnr(expected, found) > 80.0


@pytest.mark.parametrize("name", ["parametric", "sgd", "abc", "tables"])
def test_pixels_with_atoms_of_their_own_are_as_rendered(name: str, tmp_path: Path) -> None:
    dictionaries = {"parametric": parametric, "tables": lambda: Dictionary("a file", atoms())}
    result = result_of(dictionaries.get(name, lambda: from_published(name))())
    facts = write_relighting_page(tmp_path / "page.html", result)
    assert (facts.n_palette, facts.n_own, facts.n_unsolved) == (0, SIZE * SIZE - 3, 3)
    page = read_page(tmp_path / "page.html")
    for camera, light in PLACES:
        assert psnr(rendered(result, camera, light), picture(page, camera, light)) > 80.0


def test_a_grey_result_is_grey(tmp_path: Path) -> None:
    result = result_of(parametric(), n_channels=1)
    write_relighting_page(tmp_path / "page.html", result)
    found = picture(read_page(tmp_path / "page.html"), *PLACES[1])
    assert psnr(rendered(result, *PLACES[1]), found) > 80.0


def test_every_model_of_a_dictionary_has_a_number() -> None:
    assert set(MODEL_CODES) == {*MODELS, "table"}
    assert len(set(MODEL_CODES.values())) == len(MODEL_CODES)


def test_a_lower_resolution_shows_some_of_the_pixels_as_they_are(tmp_path: Path) -> None:
    result = small_result()
    facts = write_relighting_page(tmp_path / "page.html", result, resolution=15)
    assert (facts.width, facts.height, facts.step) == (13, 13, 3)
    camera, light = PLACES[1]
    expected = rendered(result, camera, light).reshape(SIZE, SIZE, 3)[1::3, 1::3].reshape(-1, 3)
    assert psnr(expected, picture(read_page(tmp_path / "page.html"), camera, light)) > 80.0


def test_an_area_that_is_one_row_has_a_page(tmp_path: Path) -> None:
    whole = small_result()
    row = np.arange(SIZE * 30, SIZE * 31)
    depth = whole.depth[30:31]
    result = replace(whole, fits=whole.fits.select(row), grid=Grid(1, SIZE, 0.25), depth=depth)
    facts = write_relighting_page(tmp_path / "page.html", result, resolution=10)
    assert (facts.width, facts.height) == (10, 1)


def test_normals_of_any_direction_come_back_to_thousandths_of_a_degree() -> None:
    n = np.random.default_rng(0).normal(size=(2000, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    o = normal_plane(n) / 32767.0 - 1.0
    z = 1.0 - np.abs(o).sum(axis=1)
    folded = (1.0 - np.abs(o[:, ::-1])) * np.where(o < 0.0, -1.0, 1.0)
    back = np.column_stack([np.where(z[:, None] < 0.0, folded, o), z])
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    assert np.rad2deg(np.linalg.norm(back - n, axis=1)).max() < 4e-3


def test_the_page_and_the_terminal_say_what_is_shown_and_how(tmp_path: Path) -> None:
    write_result(tmp_path / "a.result.h5", small_result())
    text = relight(tmp_path / "a.result.h5", tmp_path / "page.html", 15)
    assert "13 x 13 pixels, one of 3 in each direction; --resolution shows more" in text
    assert "own atoms   0.0%" in text
    page = (tmp_path / "page.html").read_text()
    assert "mixtures of 5 materials" in page
    assert "not solved, shown as holes" in page
    assert "one of 3 in each direction" in page


def test_the_page_needs_nothing_beside_it(tmp_path: Path) -> None:
    write_relighting_page(tmp_path / "page.html", small_result(), title="<b>&")
    page = (tmp_path / "page.html").read_text()
    assert "http" not in page
    assert "src=" not in page
    assert "<title>&lt;b&gt;&amp;" in page


def test_what_cannot_be_shown_is_refused(tmp_path: Path) -> None:
    whole = small_result()
    unsolved = replace(whole.fits, normals=np.full_like(whole.fits.normals, np.nan))
    with pytest.raises(InvalidInputError, match="no pixel of it is solved"):
        write_relighting_page(tmp_path / "page.html", replace(whole, fits=unsolved))
    two = replace(whole.fits, atom=whole.fits.atom[:, :2], coefficient=whole.fits.coefficient[:, :2])
    with pytest.raises(InvalidInputError, match="has 2 channels"):
        write_relighting_page(tmp_path / "page.html", replace(whole, fits=two))
    assert not (tmp_path / "page.html").exists()
