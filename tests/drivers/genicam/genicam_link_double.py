"""A camera as the driver sees it through its link: for what Aravis' own camera does not have, or does not do wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.errors import DeviceError, DeviceLostError
from drivers.genicam.camera import GenicamCamera
from drivers.genicam.link import Identity, RawFrame, Region, Steps, Value
from drivers.genicam.settings import GenicamSettings

WIDTH, HEIGHT = 16, 8


@dataclass
class LinkDouble:
    """A colour camera with 1920 x 1200 pixels, 12 bits, automatics that are on, and features of today's names.

    Attributes
    ----------
    keep : callable
        Takes a number's name and its value as set; returns what the camera makes of it.
    ids : list of int
        The camera's own numbers of the frames to come, one a trigger; counts on from the last.
    late : list of RawFrame
        Arrive without a trigger.
    """

    identity: Identity = field(default_factory=lambda: Identity("Maker", "Camera", "42", "1.2"))
    features: dict[str, object] = field(
        default_factory=lambda: {
            "PixelFormat": "BayerRG8",
            "ExposureAuto": "Continuous",
            "GainAuto": "Continuous",
            "GammaEnable": True,
            "AcquisitionFrameRateEnable": True,
        }
    )
    formats: tuple[str, ...] = ("Mono8", "BayerRG8", "BayerRG12", "BayerRG12Packed", "BayerRG12p", "RGB8")
    numbers: dict[str, float] = field(default_factory=lambda: {"exposure_time": 0.01, "gain": 12.0, "black_level": 1.5})
    ranges: dict[str, tuple[float, float]] = field(
        default_factory=lambda: {"exposure_time": (1e-5, 30.0), "gain": (-2.0, 24.0), "black_level": (0.0, 10.0)}
    )
    units: dict[str, str] = field(default_factory=lambda: {"exposure_time": "s", "gain": "dB", "black_level": "%"})
    sides: dict[str, Steps] = field(
        default_factory=lambda: {
            "width": Steps(16, 1920, 16),
            "height": Steps(2, 1200, 2),
            "x_offset": Steps(0, 1904, 2),
            "y_offset": Steps(0, 1198, 2),
        }
    )
    place: Region = field(default_factory=lambda: Region(0, 0, 1920, 1200))
    keep: Callable[[str, float], float] = lambda _name, value: value
    stubborn: tuple[str, ...] = ()
    locked: tuple[str, ...] = ()
    selections: dict[str, tuple[str, ...]] = field(default_factory=dict)
    warmth: float = math.nan
    ids: list[int] = field(default_factory=list)
    late: list[RawFrame] = field(default_factory=list)
    data: bytes | None = None
    is_open: bool = True
    is_there: bool = True
    n_starts: int = 0
    is_waiting: bool = False
    pending: list[RawFrame] = field(default_factory=list)
    last_id: int = 0

    def close(self) -> None:
        self.is_open = False

    def has(self, feature: str) -> bool:
        return feature in self.features

    def text(self, feature: str) -> str:
        return str(self.features[feature])

    def set_text(self, feature: str, value: str) -> None:
        if feature not in self.stubborn:
            self.features[feature] = value

    def choices(self, feature: str) -> tuple[str, ...]:
        return self.formats if feature == "PixelFormat" else self.selections.get(feature, ("Off", "Continuous"))

    def value(self, feature: str) -> Value:
        selector = f"{feature}Selector"
        if isinstance(found := self.features[feature], dict):
            found = found[self.features[selector]]
        assert isinstance(found, str | bool | float)
        return found

    def set_value(self, feature: str, value: Value) -> None:
        assert isinstance(value, type(self.value(feature)))
        assert not isinstance(value, str) or value in self.choices(feature)
        if feature in self.locked:
            raise DeviceError(f"{feature} is locked")
        if feature in self.stubborn:
            return
        if isinstance(parts := self.features[feature], dict):
            parts[self.features[f"{feature}Selector"]] = value
        else:
            self.features[feature] = value

    def has_number(self, name: str) -> bool:
        return name in self.numbers

    def number(self, name: str) -> float:
        return self.numbers[name]

    def set_number(self, name: str, value: float) -> None:
        self.numbers[name] = self.keep(name, value)

    def bounds(self, name: str) -> tuple[float, float]:
        return self.ranges[name]

    def unit(self, name: str) -> str:
        return self.units[name]

    def temperature(self) -> float:
        return self.warmth

    def steps(self, side: str) -> Steps:
        return self.sides[side]

    def region(self) -> Region:
        return self.place

    def set_region(self, region: Region) -> None:
        self.place = region

    def start(self) -> None:
        self.stop()
        self.n_starts += 1
        self.is_waiting = True

    def stop(self) -> None:
        self.is_waiting = False
        self.pending.clear()

    def trigger(self) -> None:
        if not self.is_waiting:
            raise DeviceError("nobody waits for a trigger")
        self.last_id = self.ids.pop(0) if self.ids else self.last_id + 1
        n_bytes = self.place.width * self.place.height * (1 if self.text("PixelFormat").endswith("8") else 2)
        self.pending.append(RawFrame(self.last_id, "", bytes(n_bytes) if self.data is None else self.data))

    def frame(self, seconds: float) -> RawFrame | None:
        waiting = self.pending or (self.late if seconds == 0.0 else [])
        return waiting.pop(0) if waiting else None

    def check_presence(self) -> None:
        if not self.is_there:
            raise DeviceLostError("the camera is gone")


def camera_of(link: LinkDouble, width: int = WIDTH, height: int = HEIGHT, **settings: object) -> GenicamCamera:
    """Return a driver for a double, not yet connected."""
    return GenicamCamera(GenicamSettings(**settings), None, width, height, lambda *_: link)
