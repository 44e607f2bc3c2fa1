from pathlib import Path

import numpy as np
import pytest

from analysis.reflectance.merl import (
    N_BYTES,
    SCALES,
    SHAPE,
    MerlBrdf,
    cell_angles,
    fill_unmeasured,
    read_merl,
)
from instrument.files.validation import InvalidInputError
from tests.merl_files import merl_brdf, merl_of, write_merl


@pytest.fixture(scope="module")
def material() -> MerlBrdf:
    return merl_brdf(2)


@pytest.fixture
def path(material: MerlBrdf, tmp_path: Path) -> Path:
    path = tmp_path / "aluminium.binary"
    write_merl(path, material)
    return path


def test_a_file_has_the_size_of_the_format(path: Path):
    assert path.stat().st_size == N_BYTES == 12 + 3 * 90 * 90 * 180 * 8


def test_a_file_read_and_written_is_the_same_to_the_bit(path: Path, tmp_path: Path):
    write_merl(tmp_path / "again.binary", read_merl(path))
    assert (tmp_path / "again.binary").read_bytes() == path.read_bytes()


def test_a_value_stands_where_the_format_says(path: Path):
    """Channel, theta_h, theta_d, phi_d, the last fastest; green is scaled by 1.15 / 1500."""
    i_h, i_d, i_phi = 7, 20, 33
    index = i_phi + i_d * 180 + i_h * 180 * 90 + 90 * 90 * 180
    stored = np.frombuffer(path.read_bytes(), "<f8", offset=12)[index]
    assert read_merl(path).stored[1, i_h, i_d, i_phi] == stored
    np.testing.assert_allclose(SCALES * 1500.0, [1.0, 1.15, 1.66], rtol=1e-12)


def test_the_angles_of_a_cell_are_looked_up_as_that_cell():
    theta_h, theta_d, phi_d = cell_angles()
    np.testing.assert_array_equal(np.floor(np.sqrt(theta_h / (np.pi / 2)) * 90), np.arange(90))
    np.testing.assert_array_equal(np.floor(np.rad2deg(theta_d)), np.arange(90))
    np.testing.assert_array_equal(np.floor(np.rad2deg(phi_d)), np.arange(180))


def test_the_average_leaves_out_what_was_not_measured():
    stored = np.full((3, *SHAPE), -1.0)
    stored[:, 5, 6, 7:9] = np.array([300.0, 600.0])
    mean, n_measured = MerlBrdf(stored).average()
    np.testing.assert_allclose(mean[:, 5, 6], 450.0 * SCALES, rtol=1e-12)
    assert n_measured[:, 5, 6].tolist() == [2, 2, 2]
    assert np.count_nonzero(np.isfinite(mean)) == np.count_nonzero(n_measured) == 3


def test_the_average_of_a_whole_row_of_cells_is_in_units_of_the_brdf():
    mean, n_measured = merl_of(np.full((3, *SHAPE), 0.25)).average()
    np.testing.assert_allclose(mean, 0.25, rtol=1e-12)
    assert np.all(n_measured == 180)


def test_unmeasured_cells_take_the_nearest_value_at_their_own_half_angle():
    table = np.add.outer(10.0 * np.arange(90), np.arange(90.0))
    holed = table.copy()
    holed[3, 60:] = np.nan
    holed[85:] = np.nan
    filled = fill_unmeasured(holed[None])[0]
    np.testing.assert_array_equal(filled[3, 60:], table[3, 59])
    np.testing.assert_array_equal(filled[85:], np.broadcast_to(table[84], (5, 90)))
    np.testing.assert_array_equal(filled[np.isfinite(holed)], table[np.isfinite(holed)])


def test_a_table_without_holes_stays_as_it_is():
    table = np.random.default_rng(0).uniform(size=(2, 90, 90))
    np.testing.assert_array_equal(fill_unmeasured(table), table)


def refusal(path: Path) -> str:
    with pytest.raises(InvalidInputError, match="cannot be read as a MERL file") as caught:
        read_merl(path)
    assert {problem.where for problem in caught.value.problems} == {str(path)}
    return str(caught.value)


def test_a_truncated_file_is_refused(path: Path):
    path.write_bytes(path.read_bytes()[:-8])
    assert f"has {N_BYTES - 8} bytes; a MERL file has {N_BYTES}: it was cut short" in refusal(path)


def test_a_file_that_is_too_long_is_refused(path: Path):
    with path.open("ab") as file:
        file.write(b"0")
    assert "holds more than one material's table" in refusal(path)


def test_foreign_sizes_and_a_wrong_length_are_told_together(path: Path):
    path.write_bytes(np.array([90, 90, 360], "<i4").tobytes())
    assert "begins with the sizes (90, 90, 360)" in refusal(path)
    assert "has 12 bytes" in refusal(path)


def test_an_empty_or_missing_file_is_refused(path: Path, tmp_path: Path):
    path.write_bytes(b"")
    assert "has 0 bytes" in refusal(path)
    assert "No such file" in refusal(tmp_path / "nowhere.binary")


def test_values_that_are_not_finite_are_counted(material: MerlBrdf, path: Path):
    stored = material.stored.copy()
    stored[0, 3, 4, 5], stored[2, 1, 1, 1] = np.nan, np.inf
    path.unlink()
    write_merl(path, MerlBrdf(stored))
    assert "2 of 4374000 values are not finite" in refusal(path)


def test_a_channel_without_a_measured_cell_is_named(material: MerlBrdf, path: Path):
    stored = material.stored.copy()
    stored[1] = -1.0
    path.unlink()
    write_merl(path, MerlBrdf(stored))
    assert "no value of green is positive" in refusal(path)


def test_a_file_is_never_overwritten(material: MerlBrdf, path: Path):
    with pytest.raises(FileExistsError):
        write_merl(path, material)


def test_values_in_the_other_order_of_bytes_are_named(tmp_path: Path):
    write_merl(tmp_path / "a.binary", merl_brdf(2))
    content = (tmp_path / "a.binary").read_bytes()
    swapped = np.frombuffer(content, "<f8", offset=12).byteswap().tobytes()
    (tmp_path / "b.binary").write_bytes(content[:12] + swapped)
    with pytest.raises(InvalidInputError, match=r"other order of bytes \(big-endian\).*Convert the file"):
        read_merl(tmp_path / "b.binary")
