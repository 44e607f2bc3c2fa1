"""A bench of fake devices that count and log every call, and fail where a test says so."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from drivers.camera import CameraDescription, Frame
from drivers.light import LightDescription, LightState
from drivers.limits import Limits
from drivers.stage import AxisDescription, StageDescription
from instrument.config.protocol import ProtocolConfig
from instrument.config.rig import RigConfig

HEIGHT, WIDTH = 16, 24
BLACK, SATURATION = 64.0, 4095.0

Script = Callable[[int, str], None]


def no_fault(_: int, __: str) -> None:
    pass


def fault_at(calls: set[int], error: type[BaseException]) -> Script:
    def script(number: int, name: str) -> None:
        if number in calls:
            raise error(f"{name} failed at call {number}")

    return script


class FakeBench:
    """What the three fakes share; every call passes `script` first."""

    def __init__(self, script: Script = no_fault, serial_number: str = "one") -> None:
        self.script = script
        self.serial_number = serial_number
        self.calls: list[str] = []
        self.lit_at_read: list[bool] = []
        self.lit = False
        self.position = {"tilt": 0.0, "turn": 0.0}

    def call(self, name: str) -> None:
        self.calls.append(name)
        self.script(len(self.calls) - 1, name)

    def devices(self, rig: Mapping[str, Any]) -> tuple["FakeCamera", "FakeLight", "FakeStage"]:
        return FakeCamera(self), FakeLight(self), FakeStage(self)


class FakeCamera:
    def __init__(self, bench: FakeBench) -> None:
        self.bench, self.exposure_time, self.n_triggers = bench, 0.0, 0

    def connect(self) -> None:
        self.bench.call("camera.connect")

    def disconnect(self) -> None:
        self.bench.calls.append("camera.disconnect")

    def describe(self) -> CameraDescription:
        limits = Limits(1e-4, 10.0, "s")
        serial = self.bench.serial_number
        return CameraDescription("acme", "fake", serial, HEIGHT, WIDTH, 12, BLACK, SATURATION, "RGGB", 2.0, 3.0, limits)

    def set_exposure_time(self, exposure_time: float) -> float:
        self.bench.call("camera.set_exposure_time")
        self.exposure_time = exposure_time
        return exposure_time

    def trigger(self) -> Frame:
        self.bench.call("camera.trigger")
        self.n_triggers += 1
        return Frame(self.counts(), self.n_triggers - 1, self.exposure_time, 30.0)

    def counts(self) -> np.ndarray:
        # One scene at each pose, whatever the exposure time.
        rng = np.random.default_rng(round(self.bench.position["turn"]))
        signal = rng.uniform(0, 6e4, (HEIGHT, WIDTH)) * self.exposure_time * self.bench.lit
        return np.minimum(BLACK + signal, SATURATION).astype(np.uint16)

    def stop(self) -> None:
        self.bench.calls.append("camera.stop")


class FakeLight:
    def __init__(self, bench: FakeBench) -> None:
        self.bench = bench

    def connect(self) -> None:
        self.bench.call("light.connect")

    def disconnect(self) -> None:
        self.bench.lit = False
        self.bench.calls.append("light.disconnect")

    def describe(self) -> LightDescription:
        return LightDescription("acme", "lamp", self.bench.serial_number, Limits(0.0, 1.0, ""))

    def on(self, level: float, max_seconds: float) -> LightState:
        self.bench.call("light.on")
        self.bench.lit = True
        return self._state()

    def off(self) -> LightState:
        # Dark before the fault, as with a light that obeys and then fails to answer.
        self.bench.lit = False
        self.bench.call("light.off")
        return self._state()

    def read(self) -> LightState:
        self.bench.call("light.read")
        return self._state()

    def _state(self) -> LightState:
        return LightState(self.bench.lit, float(self.bench.lit), 1.0, 25.0)


class FakeStage:
    def __init__(self, bench: FakeBench) -> None:
        self.bench = bench

    def connect(self) -> None:
        self.bench.call("stage.connect")

    def disconnect(self) -> None:
        self.bench.calls.append("stage.disconnect")

    def describe(self) -> StageDescription:
        tilt = AxisDescription("tilt", "rotation", Limits(-60.0, 60.0, "deg"), 0.01, (1.0, 0.0, 0.0))
        turn = AxisDescription("turn", "rotation", Limits(-360.0, 360.0, "deg"), 0.01, (0.0, 0.0, 1.0))
        return StageDescription("acme", "goniometer", self.bench.serial_number, (tilt, turn))

    def home(self) -> None:
        self.bench.call("stage.home")
        self.bench.position = {"tilt": 0.0, "turn": 0.0}

    def move(self, target: Mapping[str, float]) -> dict[str, float]:
        assert not self.bench.lit, "the light is on while the stage moves"
        self.bench.call("stage.move")
        self.bench.position |= target
        return self.read()

    def move_duration(self, target: Mapping[str, float]) -> float:
        return max(abs(value) for value in target.values()) / 10

    def read(self) -> dict[str, float]:
        return dict(self.bench.position)

    def stop(self) -> None:
        self.bench.calls.append("stage.stop")


BOARD = {
    "kind": "charuco",
    "dictionary": "DICT_4X4_50",
    "first_id": 8,
    "squares": (4, 3),
    "square_mm": 5.5,
    "marker_mm": 4.4,
    "corner_mm": (32.0, 54.0),
}


def rig_config(**tables: Any) -> RigConfig:
    values: dict[str, Any] = {
        "name": "bench",
        "camera": {"driver": "simulated", "width": WIDTH, "height": HEIGHT, "focal_length_px": 50.0},
        "light": {"driver": "simulated", "offset_mm": (12.0, 1.0, 0.5), "offset_sigma_mm": 3.0, "level": 0.8},
        "stage": {"driver": "simulated"},
        "geometry": {"working_distance_mm": 350.0, "area_mm": (60.0, 40.0)},
        "boards": (BOARD,),
    }
    return RigConfig.model_validate(values | tables)


def protocol_config(count: int = 2, darks: int = 2, times: tuple[float, ...] = (0.01, 0.1)) -> ProtocolConfig:
    values = {
        "name": "two views",
        "sample": "coin",
        "bracket": {"exposure_times_s": times, "darks": darks},
        "rings": ({"tilt_deg": 10.0, "count": count, "start_deg": 5.0},),
    }
    return ProtocolConfig.model_validate(values)
