import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from cli.main import halfangle
from drivers import discovery
from drivers.discovery import Discovery
from drivers.driver import DeviceState, FoundDevice
from tests.cli.test_capture import RIG


@pytest.fixture
def rig(tmp_path: Path) -> str:
    (tmp_path / "rig.toml").write_text(RIG)
    return str(tmp_path / "rig.toml")


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> Discovery:
    found = Discovery(
        [
            FoundDevice("Thorlabs DC2200 M1", "usb 1-2", DeviceState.FOUND, "", "light", "scpi"),
            FoundDevice("Arduino Uno", "/dev/ttyACM0", DeviceState.BUSY, "it is open in process 7; close that"),
        ],
        ["camera.oak: depthai is not installed"],
    )
    monkeypatch.setattr(discovery, "discover", lambda: found)
    return found


def test_devices_lists_each_with_its_state_driver_and_remedy(found: Discovery) -> None:
    shown = CliRunner().invoke(halfangle, ["devices"])
    assert shown.exit_code == 0
    assert shown.output.splitlines() == [
        'found          Thorlabs DC2200 M1  (light, driver = "scpi"; usb 1-2)',
        "busy           Arduino Uno  (no driver; /dev/ttyACM0)",
        "               it is open in process 7; close that",
        "not looked for: camera.oak: depthai is not installed",
    ]


def test_devices_are_json_for_a_program(found: Discovery) -> None:
    told = json.loads(CliRunner().invoke(halfangle, ["devices", "--json"]).output)
    assert [device["state"] for device in told["devices"]] == ["found", "busy"]
    assert told["not_looked_for"] == found.not_looked_for


def test_where_nothing_is_attached_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "discover", Discovery)
    assert CliRunner().invoke(halfangle, ["devices"]).output == "nothing is attached that a driver knows\n"


def test_rig_check_passes_on_a_simulated_rig_and_prints_each_step(rig: str) -> None:
    shown = CliRunner().invoke(halfangle, ["rig", "check", rig, "--home"])
    assert shown.exit_code == 0, shown.output
    assert {line[:4] for line in shown.output.splitlines()} == {"PASS"}
    told = json.loads(CliRunner().invoke(halfangle, ["rig", "check", rig, "--json"]).output)
    assert {finding["kind"] for finding in told} == {"light", "stage", "camera"}


def test_rig_check_fails_where_a_device_is_another_one(rig: str) -> None:
    Path(rig).write_text(
        RIG.replace('stage = { driver = "simulated"', 'stage = { driver = "simulated", serial_number = "x"')
    )
    shown = CliRunner().invoke(halfangle, ["rig", "check", rig])
    assert shown.exit_code == 1
    assert "FAIL  stage   its serial number is 'sim-0'; [stage] asks for 'x'" in shown.output


def test_the_contracts_run_on_the_devices_of_a_rig_file(rig: str) -> None:
    command = [sys.executable, "-c", "from cli.main import main; main()", "driver-test", rig]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stdout
    assert all(f"Test{kind}" in done.stdout for kind in ("Camera", "Light", "Stage"))


def test_nobody_is_asked_about_a_real_stage_without_an_answer(rig: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.registry.is_simulated", lambda _: False)
    shown = CliRunner().invoke(halfangle, ["driver-test", rig])
    assert shown.exit_code == 1
    assert "Is the sample away?" in shown.output
    assert "passed" not in shown.output
