"""The contracts, run on the devices of a rig file: `halfangle driver-test`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import pytest

from drivers.camera import Camera
from drivers.contracts.camera import CameraContract
from drivers.contracts.light import LightContract
from drivers.contracts.stage import StageContract
from drivers.driver import Kind
from drivers.light import Light
from drivers.registry import Devices, open_devices
from drivers.stage import Stage


def run_contracts(rig: Mapping[str, Any], kinds: Sequence[Kind]) -> bool:
    """Run the contracts of some kinds on the devices of a parsed rig file; tell whether all passed."""
    # What else is installed beside pytest is for other tests, and may want a display or a clock of its own.
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    wanted = [f"{__file__}::Test{kind.capitalize()}" for kind in kinds]
    options = [
        "-v",
        "--tb=short",
        "--no-header",
        "-p",
        "no:cacheprovider",
        "-c",
        os.devnull,
        f"--rootdir={__file__}/..",
    ]
    return pytest.main([*options, *wanted], plugins=[_Bench(rig)]) == pytest.ExitCode.OK


class _Bench:
    """Gives the tests a rig's devices, opened anew for each."""

    def __init__(self, rig: Mapping[str, Any]) -> None:
        self._rig = rig

    @pytest.fixture
    def devices(self) -> Devices:
        return open_devices(self._rig)

    @pytest.fixture
    def camera(self, devices: Devices) -> Camera:
        return devices.camera

    @pytest.fixture
    def light(self, devices: Devices) -> Iterator[Light]:
        yield devices.light
        # Whatever a test that failed has left behind.
        devices.light.disconnect()

    @pytest.fixture
    def stage(self, devices: Devices) -> Iterator[Stage]:
        yield devices.stage
        devices.stage.disconnect()

    @pytest.fixture
    def wait(self, devices: Devices) -> Callable[[float], None]:
        return devices.clock.sleep

    @pytest.fixture
    def now(self, devices: Devices) -> Callable[[], float]:
        return devices.clock.now


class TestCamera(CameraContract):
    """Of the rig's camera."""


class TestLight(LightContract):
    """Of the rig's light."""


class TestStage(StageContract):
    """Of the rig's stage."""
