import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from cli.main import halfangle
from drivers import discovery
from drivers.discovery import Discovery
from drivers.driver import DeviceState, FoundDevice
from drivers.errors import DeviceError
from drivers.light import LightState
from drivers.simulated.light import SimulatedLight
from instrument.files.validation import InvalidInputError
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


def test_rig_safe_leaves_the_rig_dark_and_says_so(rig: str) -> None:
    shown = CliRunner().invoke(halfangle, ["rig", "safe", rig])
    assert shown.output == "the light is off, stage and camera are stopped\n"
    assert shown.exit_code == 0


def test_rig_safe_fails_where_the_light_will_not_go_off(rig: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SimulatedLight, "off", lambda self: LightState(True, 1.0, 1.0, 20.0))
    with pytest.raises(DeviceError, match="still reports that it shines"):
        halfangle(["rig", "safe", rig], standalone_mode=False)


def test_rig_frame_says_what_the_live_picture_says_and_writes_the_raw_counts(rig: str, tmp_path: Path) -> None:
    picture = tmp_path / "frame.png"
    arguments = ["rig", "frame", rig, "--exposure-time", "0.02", "-o", str(picture), "--json"]
    shown = CliRunner().invoke(halfangle, arguments)
    assert shown.exit_code == 0, shown.output
    told = json.loads(shown.output)
    counts = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)
    assert counts.dtype == np.uint16
    assert told["clipped"] == pytest.approx((counts >= 4095).mean())
    assert abs(told["median_counts"] - np.median(counts)) <= 16
    assert told["exposure_time_s"] == pytest.approx(0.02)


def test_rig_frame_tells_of_a_region(rig: str, tmp_path: Path) -> None:
    picture = tmp_path / "frame.tif"
    arguments = ["rig", "frame", rig, "--exposure-time", "0.1", "-o", str(picture), "--region", "10", "20", "20", "40"]
    told = json.loads(CliRunner().invoke(halfangle, [*arguments, "--json"]).output)
    region = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)[10:20, 20:40]
    assert abs(told["median_counts"] - np.median(region)) <= 16


def test_rig_frame_refuses_what_it_cannot_write_before_the_light_shines(
    rig: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SimulatedLight, "on", None)
    with pytest.raises(InvalidInputError, match=r"is no picture of 16 bits; use \.png or \.tif"):
        halfangle(["rig", "frame", rig, "-o", "frame.jpg"], standalone_mode=False)
    (tmp_path / "there.png").write_bytes(b"somebody's")
    for name, message in (("there.png", "exists and is not overwritten"), ("no/where.png", "is no folder")):
        with pytest.raises(InvalidInputError, match=message):
            halfangle(["rig", "frame", rig, "-o", str(tmp_path / name)], standalone_mode=False)
    assert (tmp_path / "there.png").read_bytes() == b"somebody's"


def test_rig_frame_says_which_exposure_times_the_camera_takes(rig: str) -> None:
    with pytest.raises(DeviceError, match=r"exposure_time is 100 s; allowed is 1e-05 to 10 s"):
        halfangle(["rig", "frame", rig, "--exposure-time", "100"], standalone_mode=False)
