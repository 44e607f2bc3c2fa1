"""Where a file system has no locks, nobody believes that the rig is held."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from filelock import FileLock

from drivers.errors import DeviceError
from instrument.rig import lock
from instrument.rig.lock import hold


@pytest.fixture(autouse=True)
def no_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def acquire(*_: object, **__: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(FileLock, "acquire", acquire)
    monkeypatch.setenv(lock.FOLDER_VARIABLE, str(tmp_path))


@pytest.mark.parametrize("setting", [None, "TRUE", "BEST_EFFORT"])
def test_a_rig_that_cannot_be_locked_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, setting: str | None
) -> None:
    monkeypatch.delenv("HDF5_USE_FILE_LOCKING", raising=False)
    if setting is not None:
        monkeypatch.setenv("HDF5_USE_FILE_LOCKING", setting)
    with pytest.raises(DeviceError, match=rf"{tmp_path}: its file system has no locks.*{lock.FOLDER_VARIABLE}"):
        hold("bench").__enter__()
    assert not (tmp_path / "bench.json").exists()


def test_who_says_that_no_other_program_runs_may_use_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HDF5_USE_FILE_LOCKING", "FALSE")
    with hold("bench"):
        assert (tmp_path / "bench.json").exists()
    assert not (tmp_path / "bench.json").exists()
