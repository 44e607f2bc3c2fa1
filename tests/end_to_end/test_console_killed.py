"""The console is killed while the light of a real rig's counterpart shines: the light goes out, the session goes on."""

import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from instrument.session.session import Session
from tests.drivers.genicam.fake_genicam import skip_without_aravis
from tests.end_to_end.real_rig import PROTOCOL, RealRig, real_rig
from tests.gui.told_console import ToldConsole

DARK_WITHIN = 3.0
"""Seconds: the light's own process finds its parent gone within one, and is given time to be scheduled."""


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[RealRig]:
    skip_without_aravis()
    with real_rig(tmp_path) as (rig, _):
        yield rig


@pytest.fixture
def console(rig: RealRig, tmp_path: Path) -> Iterator[ToldConsole]:
    (tmp_path / "console").mkdir()
    rig.protocol.write_text(PROTOCOL.replace("count = 3", "count = 12"))
    environment = rig.environment | {"QT_QPA_PLATFORM": "offscreen", "XDG_CONFIG_HOME": str(tmp_path / "settings")}
    words = ["console", "--rig", str(rig.rig)]
    console = ToldConsole(tmp_path / "console", words, environment)
    yield console
    if console.process.poll() is None:
        console.process.kill()
    console.process.communicate()


def wait_until(holds: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)


def test_the_light_goes_out_when_the_console_is_killed_while_live(rig: RealRig, console: ToldConsole):
    console.order("rig.live")
    console.wait_until(lambda told: told["light"] == "LIGHT ON" and "median" in told["frames"])
    assert rig.light_level > 0.0
    console.process.send_signal(signal.SIGKILL)
    wait_until(lambda: rig.light_level == 0.0, DARK_WITHIN)


def test_a_console_that_is_killed_within_a_capture_leaves_the_light_off_and_a_session_that_goes_on(
    rig: RealRig, console: ToldConsole
):
    console.write("protocol", str(rig.protocol))
    console.write("session", str(rig.session))
    console.order("capture.start")
    console.wait_until(lambda told: told["state"].startswith("pose 3"))
    wait_until(lambda: rig.light_level > 0.0, 30.0)
    console.process.send_signal(signal.SIGKILL)
    wait_until(lambda: rig.light_level == 0.0, DARK_WITHIN)
    resumed = rig.run("resume", rig.session)
    assert resumed.returncode in (0, 3), resumed.stderr
    with Session(rig.session) as session:
        assert session.pose_complete.all()
        assert session.n_poses == 12
