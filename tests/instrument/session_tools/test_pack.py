"""A packed session is smaller, and the same in every value."""

import errno
import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from instrument.files.validation import InvalidInputError
from instrument.recording.creation import SessionExistsError
from instrument.session import layout
from instrument.session.session import Session
from instrument.session_tools import pack
from instrument.session_tools.pack import differences, pack_session
from protocols.capture.engine import capture, resume
from tests.instrument.conftest import Change
from tests.protocols.fakes import FakeBench, fault_at, protocol_config, rig_config
from tests.verifying import verify_session


def assert_same(one: Path, other: Path) -> None:
    with h5py.File(one) as a, h5py.File(other) as b:
        assert list(differences(a, b)) == []
        for paths in ([layout.IMAGES.path, f"{layout.RAW}/images"], [layout.ORDER.path, f"{layout.OVERVIEW}/pose"]):
            assert b[paths[0]] == b[paths[1]]
    with Session(one) as a, Session(other) as b:
        assert a.digest() == b.digest()


def test_a_packed_session_is_smaller_and_the_same(session_path: Path, tmp_path: Path) -> None:
    steps: list[tuple[int, int, str]] = []
    before = session_path.read_bytes(), session_path.stat().st_mtime_ns
    pack_session(session_path, tmp_path / "small.h5", lambda *step: steps.append(step))
    assert_same(session_path, tmp_path / "small.h5")
    assert (tmp_path / "small.h5").stat().st_size < session_path.stat().st_size
    assert list(verify_session(tmp_path / "small.h5")) == []
    assert steps[-1][0] == steps[-1][1] == len(steps)
    assert (session_path.read_bytes(), session_path.stat().st_mtime_ns) == before


def test_what_was_written_more_than_once_takes_no_place(changed: Callable[[Change], Path], tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 65536, 200_000, np.uint16)

    def add(file: h5py.File) -> None:
        file["first"], file["last"] = noise, noise

    path = changed(add)
    with h5py.File(path, "r+") as file:
        del file["first"]
    pack_session(path, tmp_path / "small.h5")
    assert (tmp_path / "small.h5").stat().st_size < path.stat().st_size - 100_000
    assert_same(path, tmp_path / "small.h5")


@pytest.mark.parametrize("number", [40])
def test_an_interrupted_session_is_resumed_in_the_packed_file(tmp_path: Path, number: int) -> None:
    path, small = tmp_path / "s.h5", tmp_path / "small.h5"
    bench = FakeBench(fault_at({number}, KeyboardInterrupt))
    capture(rig_config(), protocol_config(count=4), path, devices=bench.devices)
    with Session(path) as session:
        assert not session.pose_complete.all()
    pack_session(path, small)
    assert_same(path, small)
    for file in (path, small):
        resume(file, devices=FakeBench().devices)
        assert list(verify_session(file)) == []
    with Session(path) as a, Session(small) as b:
        assert a.digest() == b.digest()
        assert b.pose_complete.all()


def test_a_damaged_session_is_not_packed(changed: Callable[[Change], Path], tmp_path: Path) -> None:
    def flip(file: h5py.File) -> None:
        file[layout.IMAGES.path][1, 0, 3, 3] ^= 1

    with pytest.raises(InvalidInputError, match="damaged and not packed") as caught:
        pack_session(changed(flip), tmp_path / "small.h5")
    assert "pose 1, exposure 0 (0.01 s) differs" in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["changed.h5"]


def test_a_file_that_exists_is_not_overwritten(session_path: Path, tmp_path: Path) -> None:
    shutil.copy(session_path, tmp_path / "s.h5")
    with pytest.raises(SessionExistsError):
        pack_session(session_path, tmp_path / "s.h5")


def test_a_copy_that_is_not_the_same_does_not_appear(
    session_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def with_another_plot(source: h5py.HLObject, target: h5py.HLObject) -> None:
        copy(source, target)
        if target.name == layout.ENTRY:
            target.attrs["default"] = "raw"

    copy = pack.copy_attributes
    monkeypatch.setattr(pack, "copy_attributes", with_another_plot)
    with pytest.raises(InvalidInputError, match="the copy is not what it was made of") as caught:
        pack_session(session_path, tmp_path / "small.h5")
    assert "/entry@default: is another attribute" in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_difference_in_any_value_type_name_or_link_is_found(
    session_path: Path, changed: Callable[[Change], Path]
) -> None:
    def change(file: h5py.File) -> None:
        file[layout.TITLE.path][()] = "another title"
        file[layout.IMAGES.path][2, 1, 5, 5] ^= 1
        del file[f"{layout.RAW}/images"], file[layout.SENSOR_TEMPERATURE.path]
        file[f"{layout.RAW}/images"] = file[layout.IMAGES.path][()]
        file[layout.COUNT_TIME.path].attrs["units"] = "ms"

    with h5py.File(session_path) as one, h5py.File(changed(change)) as other:
        found = {problem.where for problem in differences(one, other)}
    assert {
        layout.TITLE.path,
        layout.IMAGES.path,
        f"{layout.RAW}/images",
        layout.SENSOR_TEMPERATURE.path,
        f"{layout.COUNT_TIME.path}@units",
        "/",
    } <= found


def test_where_there_are_no_locks_a_session_is_packed(
    session_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", no_locks)
    pack_session(session_path, tmp_path / "packed.h5")
    assert list(verify_session(tmp_path / "packed.h5")) == []
    assert list(tmp_path.iterdir()) == [tmp_path / "packed.h5"]
