"""What the tests of faults share."""

from __future__ import annotations

import pytest

from instrument.rig import bounded
from protocols.capture.engine import Finish
from tests.faults import bench


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """The content of a capture without a fault."""
    run = bench.run(tmp_path_factory.mktemp("whole") / "s.h5")
    assert run.finish is Finish.COMPLETE
    return bench.content(run.path)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for a second only for what never comes."""
    for name in ("COMMAND_LIMIT", "FRAME_MARGIN", "MOVE_MARGIN", "CONNECT_LIMIT", "HOME_LIMIT"):
        monkeypatch.setattr(bounded, name, 1.0)
