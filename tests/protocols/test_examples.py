"""The protocols in examples/ run on the simulated rig, small and with few poses."""

from pathlib import Path

import pytest

from instrument.config.loading import load_rig
from instrument.session.session import Session
from protocols.capture.engine import Finish, capture
from protocols.planning.python_protocol import load_any_protocol
from tests.verifying import verify_session

EXAMPLES = Path(__file__).parents[2] / "examples"
PROTOCOLS = sorted(
    path for path in EXAMPLES.glob("*.*") if path.name not in ("simulated.toml", "real_rig.toml", "faults.toml")
)


@pytest.mark.parametrize("path", PROTOCOLS, ids=lambda path: path.name)
def test_every_example_captures_a_session_that_verifies(path: Path, tmp_path: Path) -> None:
    rig = load_rig(EXAMPLES / "simulated.toml")
    small = rig.camera.model_copy(update={"width": 64, "height": 48, "focal_length_px": 125.0})
    outcome = capture(rig.model_copy(update={"camera": small}), load_any_protocol(path), tmp_path / "s.h5")
    assert outcome.finish is Finish.COMPLETE
    assert list(verify_session(tmp_path / "s.h5")) == []
    with Session(tmp_path / "s.h5") as session:
        assert session.pose_complete.all()
        assert session.protocol_text == path.read_text()
