from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.pixels.problem import samples_of
from analysis.registration import stack_file
from analysis.registration.stack import Stack
from analysis.registration.stack_file import read_stack, write_stack, write_truth
from instrument.files.validation import InvalidInputError
from tests.synthetic import make_stack

GEOMETRY = "/entry/geometry"
RADIANCE = "/entry/stack/radiance"


@pytest.fixture(scope="module")
def small() -> Stack:
    stack = make_stack(n_views=5, size=6)
    return replace(
        stack,
        saturated=(stack.radiance > np.percentile(stack.radiance, 95)).astype(np.uint8),
        light_offset=np.array([12.0, 0.0, 0.0]),
        light_offset_sigma=np.ones(3),
    )


@pytest.fixture
def path(small: Stack, tmp_path: Path) -> Path:
    path = tmp_path / "sample.stack.h5"
    write_stack(path, small)
    return path


def spoil(path: Path, *defects: Callable[[h5py.File], None]) -> None:
    with h5py.File(path, "r+") as file:
        for defect in defects:
            defect(file)


def put(name: str, value: object) -> Callable[[h5py.File], None]:
    """Return the defect that replaces the dataset `name`."""

    def defect(file: h5py.File) -> None:
        if name in file:
            del file[name]
        if value is not None:
            file[name] = value

    return defect


def refusal(path: Path) -> InvalidInputError:
    with pytest.raises(InvalidInputError) as caught:
        read_stack(path)
    assert str(path) in str(caught.value)
    return caught.value


def assert_same(a: object, b: object) -> None:
    for field in fields(a):
        ours, theirs = getattr(a, field.name), getattr(b, field.name)
        if isinstance(ours, np.ndarray):
            np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-7, err_msg=field.name)
        elif field.name == "truth" and ours is not None:
            assert_same(ours, theirs)
        else:
            assert ours == theirs, field.name


def test_a_stack_reads_back_as_it_was_written(small: Stack, path: Path):
    back = read_stack(path)
    assert_same(back, small)
    np.testing.assert_array_equal(back.radiance, small.radiance)
    assert back.radiance.dtype == np.float32


def test_what_is_optional_may_be_missing(small: Stack, tmp_path: Path):
    bare = replace(
        small,
        variance=None,
        saturated=None,
        camera_rotation=None,
        light_offset=None,
        light_offset_sigma=None,
        truth=None,
        pixels="independent",
    )
    write_stack(tmp_path / "bare.stack.h5", bare)
    assert_same(read_stack(tmp_path / "bare.stack.h5"), bare)


def test_without_a_light_power_all_views_have_the_same(path: Path):
    spoil(path, put(f"{GEOMETRY}/light_power", None))
    np.testing.assert_array_equal(read_stack(path).light_power, np.ones(5))


def test_radiance_of_another_number_type_is_converted(small: Stack, path: Path):
    counts = (1e9 * small.radiance).astype(np.uint16)
    spoil(path, put(RADIANCE, counts))
    back = read_stack(path)
    assert back.radiance.dtype == np.float32
    np.testing.assert_array_equal(back.radiance, counts)


def test_a_large_stack_stays_in_its_file_and_gives_the_same_bits(path: Path, small: Stack, monkeypatch):
    pixels = np.array([0, 7, 8, 9, 30])
    depth = 0.1 * np.arange(36.0).reshape(6, 6)
    in_memory = [samples_of(replace(read_stack(path), followed=z), pixels) for z in (None, depth)]
    monkeypatch.setattr("analysis.registration.stack_file.IN_MEMORY_BYTES", 100)
    on_disk = read_stack(path)
    assert isinstance(on_disk.radiance, h5py.Dataset)
    for followed, expected in zip((None, depth), in_memory, strict=True):
        for ours, theirs in zip(samples_of(replace(on_disk, followed=followed), pixels), expected, strict=True):
            np.testing.assert_array_equal(ours, theirs)
            assert ours.dtype == theirs.dtype


def test_a_large_stack_of_counts_gives_the_same_samples(path: Path, small: Stack, monkeypatch):
    counts = (1e9 * small.radiance).astype(np.uint16)
    spoil(path, put(RADIANCE, counts))
    monkeypatch.setattr("analysis.registration.stack_file.IN_MEMORY_BYTES", 100)
    samples = samples_of(read_stack(path), np.arange(36))
    np.testing.assert_array_equal(samples.radiance.reshape(counts.shape), counts)


def test_a_large_compressed_stack_is_read_at_once(path: Path, small: Stack, monkeypatch):
    with h5py.File(path, "r+") as file:
        del file[RADIANCE]
        file.create_dataset(RADIANCE, data=small.radiance, compression="gzip")
    monkeypatch.setattr("analysis.registration.stack_file.IN_MEMORY_BYTES", 100)
    np.testing.assert_array_equal(read_stack(path).radiance, small.radiance)


def test_a_refused_stack_is_not_left_open(path: Path, monkeypatch):
    spoil(path, put(f"{GEOMETRY}/light_power", np.zeros(5)))
    monkeypatch.setattr("analysis.registration.stack_file.IN_MEMORY_BYTES", 100)
    refusal(path)
    with h5py.File(path, "r+") as file:
        assert RADIANCE in file


def test_a_pitch_in_an_array_of_one_is_taken(path: Path):
    spoil(path, put(f"{GEOMETRY}/pixel_pitch", np.array([0.4])))
    assert read_stack(path).pixel_pitch == 0.4


def test_a_stack_is_never_overwritten(small: Stack, path: Path):
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        write_stack(path, small)
    assert path.read_bytes() == before


def test_the_axes_follow_nexus(path: Path):
    with h5py.File(path) as file:
        assert file.attrs["default"] == "entry"
        assert file["/entry/stack"].attrs["signal"] == "radiance"
        assert file[f"{GEOMETRY}/camera_position"].attrs["units"] == "mm"


def behind(view: int) -> np.ndarray:
    position = make_stack(n_views=5, size=2).camera_position
    position[view, 2] = -100.0
    return position


def missing_in(view: int) -> np.ndarray:
    position = make_stack(n_views=5, size=2).camera_position
    position[view, 0] = np.nan
    return position


def zero_power() -> np.ndarray:
    return np.array([1.0, 1.0, 0.0, 1.0, 1.0])


def as_pixels(value: str) -> Callable[[h5py.File], None]:
    return lambda file: file[RADIANCE].attrs.update({"pixels": value})


MALFORMED = {
    "no radiance": (put(RADIANCE, None), RADIANCE, "missing"),
    "radiance of three axes": (put(RADIANCE, np.zeros((5, 6, 6))), RADIANCE, r"(5, 6, 6)"),
    "radiance of two channels": (put(RADIANCE, np.zeros((5, 6, 6, 2))), RADIANCE, "channels 1 or 3"),
    "radiance of no views": (put(RADIANCE, np.zeros((0, 6, 6, 3))), RADIANCE, "must be (views, height, width"),
    "radiance of text": (put(RADIANCE, np.full((5, 6, 6, 3), b"a")), RADIANCE, "must be numbers"),
    "radiance of complex numbers": (put(RADIANCE, np.zeros((5, 6, 6, 3), complex)), RADIANCE, "must be numbers"),
    "radiance without a value": (put(RADIANCE, np.full((5, 6, 6, 3), np.nan)), RADIANCE, "no finite value"),
    "no camera": (put(f"{GEOMETRY}/camera_position", None), f"{GEOMETRY}/camera_position", "missing"),
    "cameras of four views": (
        put(f"{GEOMETRY}/camera_position", np.ones((4, 3))),
        f"{GEOMETRY}/camera_position",
        "has shape (4, 3); must be (5, 3)",
    ),
    "a camera behind the sample": (
        put(f"{GEOMETRY}/camera_position", behind(2)),
        f"{GEOMETRY}/camera_position",
        "views [2] lie behind the sample",
    ),
    "a light that is nowhere": (
        put(f"{GEOMETRY}/light_position", missing_in(3)),
        f"{GEOMETRY}/light_position",
        "not finite in views [3]",
    ),
    "cameras of text": (
        put(f"{GEOMETRY}/camera_position", np.full((5, 3), b"far")),
        f"{GEOMETRY}/camera_position",
        "has type |S3; must be numbers",
    ),
    "a pitch of two": (
        put(f"{GEOMETRY}/pixel_pitch", np.array([0.4, 0.5])),
        f"{GEOMETRY}/pixel_pitch",
        "pixels must be square",
    ),
    "a negative pitch": (put(f"{GEOMETRY}/pixel_pitch", -0.4), f"{GEOMETRY}/pixel_pitch", "must be a positive"),
    "a light without power": (put(f"{GEOMETRY}/light_power", zero_power()), f"{GEOMETRY}/light_power", "positive"),
    "powers of four views": (put(f"{GEOMETRY}/light_power", np.ones(4)), f"{GEOMETRY}/light_power", "must be (5,)"),
    "an offset of two": (put(f"{GEOMETRY}/light_offset", np.ones(2)), f"{GEOMETRY}/light_offset", "must be (3,)"),
    "an offset's sigma of two": (
        put(f"{GEOMETRY}/light_offset_sigma", np.ones(2)),
        f"{GEOMETRY}/light_offset_sigma",
        "must be (3,)",
    ),
    "variance of another size": (
        put("/entry/stack/variance", np.zeros((5, 6, 7, 3))),
        "/entry/stack/variance",
        "has shape (5, 6, 7, 3); must be (5, 6, 6, 3)",
    ),
    "variance that is a group": (
        lambda file: (put("/entry/stack/variance", None)(file), file.create_group("/entry/stack/variance")),
        "/entry/stack/variance",
        "is no dataset",
    ),
    "truth of another size": (put("/entry/truth/depth", np.zeros((5, 6))), "/entry/truth/depth", "must be (6, 6)"),
    "pixels of an unknown kind": (as_pixels("loose"), RADIANCE, "must be 'surface' or 'independent'"),
}


@pytest.mark.parametrize(("defect", "where", "what"), MALFORMED.values(), ids=MALFORMED)
def test_a_malformed_stack_is_refused_by_the_path_of_what_is_wrong(path: Path, defect, where: str, what: str):
    spoil(path, defect)
    error = refusal(path)
    assert [p for p in error.problems if where in p.where and what in p.what], str(error)


def test_two_defects_are_two_problems(path: Path):
    spoil(path, put(f"{GEOMETRY}/camera_position", None), put("/entry/stack/variance", np.zeros((1, 2))))
    assert {p.where for p in refusal(path).problems} == {f"{GEOMETRY}/camera_position", "/entry/stack/variance"}


def test_two_wrong_values_are_two_problems(path: Path):
    spoil(path, put(f"{GEOMETRY}/pixel_pitch", np.nan), put(f"{GEOMETRY}/light_position", missing_in(0)))
    assert {p.where for p in refusal(path).problems} == {f"{GEOMETRY}/pixel_pitch", f"{GEOMETRY}/light_position"}


@pytest.mark.parametrize("through_soft_link", [False, True])
@pytest.mark.parametrize("name", [RADIANCE, f"{GEOMETRY}/camera_position", "/entry/stack/variance"])
def test_data_in_another_file_are_not_read(path: Path, tmp_path: Path, name: str, through_soft_link: bool):
    """A stack is handed on; it must not reach for other files of whoever opens it."""
    other = tmp_path / "other.h5"
    with h5py.File(path) as file, h5py.File(other, "w") as target:
        file.copy(name, target, "secret")

    def link(file: h5py.File) -> None:
        del file[name]
        if through_soft_link:
            file["/aside"] = h5py.ExternalLink(str(other), "/secret")
            file[name] = h5py.SoftLink("/aside")
        else:
            file[name] = h5py.ExternalLink(str(other), "/secret")

    spoil(path, link)
    assert [p for p in refusal(path).problems if p.where == name]


def test_a_missing_file_is_named(tmp_path: Path):
    error = refusal(tmp_path / "nowhere.stack.h5")
    assert error.problems[0].what == "there is no such file"


def test_a_file_of_another_kind_is_told(tmp_path: Path):
    other = tmp_path / "notes.stack.h5"
    other.write_text("not HDF5")
    assert "this is not an HDF5 file" in refusal(other).problems[0].what


def test_an_empty_hdf5_file_lacks_its_radiance(tmp_path: Path):
    h5py.File(tmp_path / "empty.stack.h5", "w").close()
    assert refusal(tmp_path / "empty.stack.h5").problems[0].where == RADIANCE


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_truncated_file_is_told(path: Path, share: float):
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert "damaged" in refusal(path).problems[0].what


def test_a_stack_that_its_reader_would_refuse_is_not_written(small: Stack, tmp_path: Path):
    behind_the_sample = small.camera_position * [1.0, 1.0, -1.0]
    with pytest.raises(
        InvalidInputError, match=r"a\.stack\.h5 is not written: .*\n.*camera_position: views .* lie behind"
    ):
        write_stack(tmp_path / "a.stack.h5", replace(small, camera_position=behind_the_sample))
    assert list(tmp_path.iterdir()) == []


def test_truth_is_added_and_all_else_stays(small: Stack, tmp_path: Path):
    assert small.truth is not None
    write_stack(tmp_path / "a.stack.h5", replace(small, truth=None))
    write_truth(tmp_path / "a.stack.h5", small.truth)
    assert_same(read_stack(tmp_path / "a.stack.h5"), small)
    assert list(tmp_path.iterdir()) == [tmp_path / "a.stack.h5"]


@pytest.mark.parametrize(("n_views", "size"), [(1, 1), (5, 6), (200, 3)])
def test_the_room_that_is_taken_for_a_stack_holds_it(tmp_path: Path, n_views: int, size: int):
    stack = make_stack(n_views=n_views, size=size)
    notes = {"calibration": '{"a": "%s"}' % ("b" * 50_000), "session_digest": "c"}
    written = replace(stack, saturated=np.ones(stack.radiance.shape, np.uint8), notes=notes)
    write_stack(tmp_path / "a.stack.h5", written)
    assert (tmp_path / "a.stack.h5").stat().st_size <= stack_file._most_bytes(written)
