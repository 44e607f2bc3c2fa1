import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from protocols.capture.engine import capture
from tests.protocols.fakes import FakeBench, protocol_config, rig_config

Change = Callable[[h5py.File], object]


@pytest.fixture(scope="session")
def session_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete session of 3 poses and 2 exposures; do not change it."""
    path = tmp_path_factory.mktemp("session") / "s.h5"
    capture(rig_config(), protocol_config(count=3), path, devices=FakeBench().devices)
    return path


@pytest.fixture
def changed(session_path: Path, tmp_path: Path) -> Callable[[Change], Path]:
    """Copy the session and change the copy."""

    def change(how: Change) -> Path:
        copy = tmp_path / "changed.h5"
        shutil.copy(session_path, copy)
        with h5py.File(copy, "r+") as file:
            how(file)
        return copy

    return change
