"""Files of the RGL database that are no such files, of another kind, or damaged."""

from __future__ import annotations

import os
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from analysis.reflectance.rgl_file import read_rgl
from instrument.files.validation import InvalidInputError
from tests.rgl_files import Fields, header_size, rgl_bytes, rgl_fields, write_rgl


def refusal(path: Path) -> str:
    with pytest.raises(InvalidInputError, match="cannot be read as a material of the RGL database") as caught:
        read_rgl(path)
    assert {problem.where for problem in caught.value.problems} == {str(path)}
    return str(caught.value)


def small() -> Fields:
    return rgl_fields(n=5, theta_i=np.deg2rad([0.0, 40.0, 80.0]))


def refused(folder: Path, fields: Fields) -> str:
    return refusal(write_rgl(folder / "a_rgb.bsdf", fields))


def test_the_fields_are_read_as_they_were_written(tmp_path: Path) -> None:
    fields = small()
    read = read_rgl(write_rgl(tmp_path / "a.bsdf", fields))
    np.testing.assert_array_equal(read.theta_i, fields["theta_i"])
    np.testing.assert_array_equal(read.rgb, fields["rgb"][0])
    np.testing.assert_array_equal(read.vndf, fields["vndf"][0])
    np.testing.assert_array_equal(read.ndf, fields["ndf"][0])
    np.testing.assert_array_equal(read.sigma, fields["sigma"][1])
    assert read.jacobian is True


def test_fields_that_are_not_needed_may_be_missing_and_others_be_there(tmp_path: Path) -> None:
    fields = small() | {"weather": np.zeros(3)}
    for name in ("version", "description", "luminance", "valid"):
        del fields[name]
    assert read_rgl(write_rgl(tmp_path / "a.bsdf", fields)).rgb.shape == (3, 3, 5, 5)


def test_of_two_phi_i_the_first_is_taken(tmp_path: Path) -> None:
    fields = small()
    for name in ("phi_i", "vndf", "luminance", "rgb"):
        fields[name] = np.concatenate([fields[name], 2.0 * fields[name]])
    np.testing.assert_array_equal(read_rgl(write_rgl(tmp_path / "a.bsdf", fields)).rgb, small()["rgb"][0])


def test_a_file_of_spectra_is_refused_with_where_the_rgb_file_is(tmp_path: Path) -> None:
    fields = small()
    fields["spectra"], fields["wavelengths"] = fields.pop("rgb"), np.arange(3, dtype=np.float32)
    assert "holds spectra; only files in RGB are read. Fetch the one" in refused(tmp_path, fields)


def test_an_anisotropic_file_is_refused_with_what_is_allowed(tmp_path: Path) -> None:
    fields = small()
    for name in ("phi_i", "vndf", "luminance", "rgb"):
        fields[name] = np.concatenate([fields[name]] * 6)
    assert "is anisotropic (6 phi_i); only isotropic materials, with one or two, are read" in refused(tmp_path, fields)


def without_ndf(fields: Fields) -> None:
    del fields["ndf"], fields["jacobian"]


def doubles(fields: Fields) -> None:
    fields["sigma"] = fields["sigma"].astype(np.float64)


def other_theta(fields: Fields) -> None:
    fields["theta_i"] = np.linspace(0.0, 1.0, 4, dtype=np.float32)


def two_channels(fields: Fields) -> None:
    fields["rgb"] = fields["rgb"][:, :, :2]


def flat(fields: Fields) -> None:
    fields["vndf"] = fields["vndf"][0]


def one_node(fields: Fields) -> None:
    fields["ndf"] = fields["ndf"][:, :1]


def not_a_number(fields: Fields) -> None:
    fields["rgb"][0, 0, 0, 0, :2] = np.nan, np.inf


def absurd(fields: Fields) -> None:
    fields["ndf"][0, 0] = 1e30


def descending(fields: Fields) -> None:
    fields["theta_i"] = fields["theta_i"][::-1].copy()


def in_degrees(fields: Fields) -> None:
    fields["theta_i"] = np.rad2deg(fields["theta_i"])


def no_area(fields: Fields) -> None:
    fields["sigma"][0, -1] = 0.0


def negative_density(fields: Fields) -> None:
    fields["vndf"][0, 1, 1, 1] = -1.0


def no_density(fields: Fields) -> None:
    fields["vndf"][0, 1] = 0.0


def no_green(fields: Fields) -> None:
    fields["rgb"][:, :, 1] = 0.0


def doubles_and_two_channels(fields: Fields) -> None:
    doubles(fields)
    two_channels(fields)
    other_theta(fields)


@pytest.mark.parametrize(
    ("damage", "messages"),
    [
        (without_ndf, ["has no field ndf, jacobian; needed are phi_i, theta_i"]),
        (doubles, ["sigma is of type 11; must be 10 (float32)"]),
        (other_theta, ["vndf has shape (1, 3, 5, 6); must have 4 along theta_i", "rgb has shape"]),
        (two_channels, ["rgb has shape (1, 3, 2, 5, 5); must have 3 along 3"]),
        (flat, ["vndf has shape (3, 5, 6); must be (phi_i, theta_i, phi, theta)"]),
        (one_node, ["ndf has shape (2, 1); must have at least 2 along theta"]),
        (not_a_number, ["rgb: 2 of 225 values are not finite, or absurd"]),
        (absurd, ["ndf: 1 of 34 values are not finite, or absurd"]),
        (descending, ["theta_i must ascend within 0 to pi / 2"]),
        (in_degrees, ["theta_i must ascend within 0 to pi / 2"]),
        (no_area, ["sigma must be positive everywhere"]),
        (negative_density, ["vndf is negative somewhere"]),
        (no_density, ["vndf is 0 for 1 of 3 theta_i"]),
        (no_green, ["no value of green is positive"]),
        (doubles_and_two_channels, ["sigma is of type 11", "must have 3 along", "must have 4 along theta_i"]),
    ],
)
def test_fields_that_cannot_be_used_are_told_together(
    tmp_path: Path, damage: Callable[[Fields], None], messages: list[str]
) -> None:
    fields = small()
    damage(fields)
    shown = refused(tmp_path, fields)
    assert [message for message in messages if message not in shown] == []


def test_what_is_no_file_of_the_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a_rgb.bsdf"
    assert "No such file" in refusal(path)
    assert "Is a directory" in refusal(tmp_path)
    for content in (b"", b"tensor", b"\x89HDF\r\n\x1a\n" + bytes(100), bytes(1000)):
        path.write_bytes(content)
        assert "does not begin with 'tensor_file'" in refusal(path)
    whole = rgl_bytes(small())
    path.write_bytes(whole[:12] + b"\x02\x01" + whole[14:])
    assert "is of version 2.1 of its format; 1.0 is read" in refusal(path)


def test_a_file_that_was_cut_is_refused_with_what_no_longer_fits(tmp_path: Path) -> None:
    path, whole = tmp_path / "a_rgb.bsdf", rgl_bytes(small())
    path.write_bytes(whole[: header_size(small()) - 1])
    assert "ends within its header: it was cut short" in refusal(path)
    path.write_bytes(whole[: len(whole) // 2])
    assert f"rgb would end at byte {len(whole) - 9} of {len(whole) // 2}: the file was cut short" in refusal(path)


def test_a_header_that_states_too_much_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    path, whole = tmp_path / "a_rgb.bsdf", bytearray(rgl_bytes(small()))
    path.write_bytes(whole[:14] + struct.pack("<I", 2**32 - 1) + whole[18:])
    assert "states 4294967295 fields; the database's files have 11" in refusal(path)
    start = whole.index(b"version")
    path.write_bytes(whole[: start + 7] + struct.pack("<H", 65535) + whole[start + 9 :])
    assert "field 'version' has 65535 axes" in refusal(path)
    start = whole.index(b"vndf") + 4 + 11
    path.write_bytes(whole[:start] + struct.pack("<4Q", *[2**63] * 4) + whole[start + 32 :])
    assert "vndf would end at byte" in refusal(path)


def test_a_field_that_is_there_twice_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a_rgb.bsdf"
    path.write_bytes(rgl_bytes(small() | {"vnde": np.zeros(1)}).replace(b"vnde", b"vndf"))
    assert "field 'vndf' is there twice" in refusal(path)


def test_a_file_far_larger_than_the_databases_is_not_read(tmp_path: Path) -> None:
    path = write_rgl(tmp_path / "a_rgb.bsdf", small())
    os.truncate(path, 20_000_000)
    assert "has 20000000 bytes; up to 16000000 are read" in refusal(path)


def read_or_refused(path: Path) -> bool:
    """Read what may be damaged, and use it if it is read; return whether it was."""
    try:
        brdf = read_rgl(path)
    except InvalidInputError:
        return False
    rng = np.random.default_rng(0)
    omega = rng.normal(size=(2, 50, 3))
    omega[..., 2] = np.abs(omega[..., 2]) + 0.05
    omega_i, omega_o = omega / np.linalg.norm(omega, axis=-1, keepdims=True)
    assert np.isfinite(brdf.evaluate(omega_i, omega_o)).all()
    return True


def test_no_byte_of_the_header_makes_the_reader_fail_or_take_memory(tmp_path: Path) -> None:
    path, fields = tmp_path / "a_rgb.bsdf", small()
    whole, n_header = rgl_bytes(fields), header_size(fields)
    tracemalloc.start()
    try:
        n_read = 0
        for place in range(n_header):
            for flip in (0x01, 0x80, 0xFF):
                path.write_bytes(whole[:place] + bytes([whole[place] ^ flip]) + whole[place + 1 :])
                n_read += read_or_refused(path)
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()
    # What remains readable: fields that are not read, and places that hold numbers as well.
    assert 0 < n_read < 0.6 * 3 * n_header


def test_a_file_that_was_cut_anywhere_is_refused_but_for_what_is_not_read(tmp_path: Path) -> None:
    path, whole = tmp_path / "a_rgb.bsdf", rgl_bytes(small())
    n_needed = len(whole) - small()["valid"].nbytes
    for n in [*range(0, n_needed, 11), n_needed - 1]:
        path.write_bytes(whole[:n])
        assert not read_or_refused(path)


def test_no_value_makes_the_reader_fail(tmp_path: Path) -> None:
    path, fields = tmp_path / "a_rgb.bsdf", small()
    whole, rng = rgl_bytes(fields), np.random.default_rng(0)
    for place in rng.integers(header_size(fields), len(whole), 400):
        n = int(rng.integers(1, 9))
        path.write_bytes(whole[:place] + rng.bytes(n) + whole[place + n :])
        read_or_refused(path)
