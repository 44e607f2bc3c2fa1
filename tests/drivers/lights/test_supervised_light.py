"""A light that goes off when its parent dies."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.contracts.light import LightContract
from drivers.errors import DeviceLostError
from drivers.light import Light
from drivers.supervised_light import SupervisedLight, supervisor_command
from tests.drivers.double_clock import until
from tests.drivers.rigs import small_rig

ROOT = Path(__file__).parents[3]

LIT_PARENT = """
import sys, time
from drivers.supervised_light import SupervisedLight

light = SupervisedLight([sys.executable, "-m", "tests.drivers.lights.recorded_light", sys.argv[1]])
light.connect()
light.on(1.0, 300.0)
print("lit", flush=True)
time.sleep(300.0)
"""


def recorded(path: Path) -> list[tuple[str, float]]:
    if not path.exists():
        return []
    return [(word, float(when)) for word, when in (line.split() for line in path.read_text().splitlines())]


class TestSupervisedLight(LightContract):
    @pytest.fixture
    def light(self, tmp_path: Path) -> Iterator[Light]:
        light = SupervisedLight([sys.executable, "-m", "tests.drivers.lights.recorded_light", str(tmp_path / "record")])
        yield light
        light.disconnect()

    @pytest.fixture
    def wait(self) -> Callable[[float], None]:
        return time.sleep

    @pytest.fixture
    def lease(self) -> float:
        return 5.0


def seconds_lit_after_death(record: Path, how: signal.Signals) -> float:
    """Kill the parent of a light with a lease of minutes."""
    parent = subprocess.Popen([sys.executable, "-c", LIT_PARENT, str(record)], stdout=subprocess.PIPE, cwd=ROOT)
    assert parent.stdout is not None
    with parent:
        assert parent.stdout.readline() == b"lit\n"
        assert recorded(record)[-1][0] == "on"
        parent.send_signal(how)
        died = time.time()
        parent.wait()
    until(lambda: recorded(record)[-1][0] == "off")
    return recorded(record)[-1][1] - died


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_the_light_goes_off_when_its_parent_dies(tmp_path: Path, how: signal.Signals) -> None:
    seconds_lit_after_death(tmp_path / "record", how)


@pytest.mark.slow
@pytest.mark.alone
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_the_light_goes_off_within_a_second_of_the_death_of_its_parent(tmp_path: Path, how: signal.Signals) -> None:
    assert seconds_lit_after_death(tmp_path / "record", how) < 1.0


def test_ctrl_c_in_a_terminal_does_not_reach_the_supervisor(tmp_path: Path) -> None:
    light = SupervisedLight([sys.executable, "-m", "tests.drivers.lights.recorded_light", str(tmp_path / "record")])
    light.connect()
    assert light._process is not None
    assert os.getpgid(light._process.pid) != os.getpgid(0)
    light._process.send_signal(signal.SIGINT)
    assert light.on(1.0, 5.0).lit
    light.disconnect()
    assert recorded(tmp_path / "record")[-1][0] == "off"


def test_a_supervisor_that_is_killed_is_a_lost_device_and_may_be_connected_again() -> None:
    light = SupervisedLight(supervisor_command(small_rig(scene="plane")))
    light.connect()
    assert light._process is not None
    light._process.kill()
    light._process.wait()
    with pytest.raises(DeviceLostError, match="supervisor"):
        light.on(1.0, 5.0)
    light.disconnect()
    light.connect()
    assert not light.read().lit
    light.disconnect()
