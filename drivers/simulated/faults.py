"""Faults on purpose: a script says which call of which simulated device goes wrong, and how."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from threading import Event

import numpy as np

from drivers.camera import Camera, CameraDescription, Frame
from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError
from drivers.light import Light, LightDescription, LightState
from drivers.simulated.world import World
from drivers.stage import Stage, StageDescription

_ANY_DEVICE = {
    "error": "the device refuses",
    "garbage": "it answers nonsense",
    "lost": "it is unplugged, and is there again at the `value`th try to connect it",
    "denied": "its port may not be opened",
    "no_answer": "it does not answer within its own time limit",
    "hang": "the call does not return until the device is stopped",
    "other_serial": "it is another one than before",
}

EFFECTS: Mapping[str, Mapping[str, str]] = {
    "camera": {
        **_ANY_DEVICE,
        "dropped_frame": "a frame is lost: the next one comes in its place",
        "repeated_frame": "the frame before comes once more",
        "stale_frame": "the picture of the exposure before comes under a new number",
        "torn_frame": "its last rows are missing",
        "clipped_frame": "every pixel is at its largest count",
        "black_frame": "the lens cap is on",
    },
    "light": {
        **_ANY_DEVICE,
        "stays_dark": "it does not come on, and says so",
        "dead": "it does not shine, and says that it does",
        "stays_on": "it does not go off, and says so",
        "stuck": "it does not go off, and says that it did",
        "drift": "its power changes by the share `value`",
    },
    "stage": {
        **_ANY_DEVICE,
        "stall": "it stops half way, and does not say so until its time limit",
        "slip": "it arrives `value` degrees away",
        "alarm": "it hits a limit switch, and moves no more until it is homed",
    },
}
"""What can be done to each kind of device: the name of the effect, and what happens."""

# Seconds on the rig's clock after which a driver gives up on a device that does not answer.
_ANSWER_LIMIT = 1.0
# Seconds that a hanging call lasts at most, so that no thread of a test outlives it by much.
_LONGEST_HANG = 60.0


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    Attributes
    ----------
    device : {"camera", "light", "stage"}
    effect : str
        One of `EFFECTS`.
    call : str
        Which method goes wrong; ``""`` = any.
    at : int
        At the how-manieth such call, from 0.
    after : float or None
        Seconds of the rig's clock after which it may go wrong, in place of `at`.
    repeats : int
        How many such calls in a row go wrong; 0 = all from then on.
    value : float
        Of an effect that has a size.
    """

    device: str
    effect: str
    call: str = ""
    at: int = 0
    after: float | None = None
    repeats: int = 1
    value: float = 0.1


class FaultScript:
    """The faults of one device, and how often each has had its call.

    Parameters
    ----------
    device : str
        Faults of other devices are none of its business.
    faults : tuple of Fault
    world : World
        Whose clock tells the time.
    """

    def __init__(self, device: str, faults: tuple[Fault, ...], world: World) -> None:
        self.device, self.world = device, world
        self._faults = [fault for fault in faults if fault.device == device]
        self._began = world.clock.now()
        self._n_calls: Counter[Fault] = Counter()
        self._n_struck: Counter[Fault] = Counter()
        self._gone: Fault | None = None
        self._n_refused = 0
        self._released = Event()

    def strike(self, call: str) -> Fault | None:
        """Return the fault that this call meets, if its effect is not an error of every device; else raise that.

        Raises
        ------
        DeviceError
            By the effect.
        """
        self._stay_gone(call)
        struck = [fault for fault in self._faults if self._meets(fault, call)]
        for fault in struck:
            self._raise_common(fault, call)
        return struck[0] if struck else None

    def release(self) -> None:
        """End a call that hangs."""
        self._released.set()

    def _meets(self, fault: Fault, call: str) -> bool:
        if fault.call and fault.call != call:
            return False
        number = self._n_calls[fault]
        self._n_calls[fault] += 1
        late = self.world.clock.now() - self._began >= fault.after if fault.after is not None else number >= fault.at
        if not late or (fault.repeats and self._n_struck[fault] >= fault.repeats):
            return False
        self._n_struck[fault] += 1
        self.world.strikes.append((self.world.clock.now(), f"{self.device}.{call}: {fault.effect}"))
        return True

    def _stay_gone(self, call: str) -> None:
        """Raise as long as the device is unplugged; a connection brings it back in the end."""
        if self._gone is None or call in ("disconnect", "stop"):
            return
        if call == "connect":
            self._n_refused += 1
            if self._n_refused >= self._gone.value:
                self._gone = None
                return
        raise DeviceLostError(f"the simulated {self.device} is not there. Look at its cable")

    def _raise_common(self, fault: Fault, call: str) -> None:
        who = f"the simulated {self.device}"
        if fault.effect == "error":
            raise DeviceError(f"{who} refused {call}")
        if fault.effect == "garbage":
            raise DeviceError(f"{who} answered {call} with nonsense; what it meant is not guessed")
        if fault.effect == "denied":
            raise DeviceError(f"there is no permission to open {who}. Add yourself to the group that owns its port")
        if fault.effect == "no_answer":
            self.world.clock.sleep(_ANSWER_LIMIT)
            raise DeviceTimeoutError(f"{who} did not answer {call} within {_ANSWER_LIMIT:g} s")
        if fault.effect == "hang":
            self._released.clear()
            self._released.wait(_LONGEST_HANG)
            raise DeviceError(f"{who} hung in {call}")
        if fault.effect == "lost":
            self._gone, self._n_refused = fault, 0
            raise DeviceLostError(f"{who} was unplugged during {call}. Look at its cable")


class FaultyCamera:
    """A camera that follows a script."""

    def __init__(self, camera: Camera, script: FaultScript) -> None:
        self._camera, self._script = camera, script
        self._last: Frame | None = None
        self._serial_number = ""

    def connect(self) -> None:
        """Open the device; safe to call twice."""
        self._script.strike("connect")
        self._camera.connect()

    def disconnect(self) -> None:
        """Close the device; safe to call twice, and without `connect`."""
        self._script.strike("disconnect")
        self._camera.disconnect()

    def describe(self) -> CameraDescription:
        """Return what the camera is."""
        fault = self._script.strike("describe")
        if fault is not None and fault.effect == "other_serial":
            self._serial_number = "another camera"
        description = self._camera.describe()
        return replace(description, serial_number=self._serial_number or description.serial_number)

    def set_exposure_time(self, exposure_time: float) -> float:
        """Set the exposure time in seconds; return what the camera reads back."""
        self._script.strike("set_exposure_time")
        return self._camera.set_exposure_time(exposure_time)

    def trigger(self) -> Frame:
        """Expose once and return the frame, or what the script makes of it."""
        fault = self._script.strike("trigger")
        if fault is not None and fault.effect == "repeated_frame" and self._last is not None:
            return self._last
        if fault is not None and fault.effect == "dropped_frame":
            self._camera.trigger()
        frame = self._camera.trigger()
        if fault is not None:
            frame = self._spoilt(frame, fault)
        self._last = frame
        return frame

    def stop(self) -> None:
        """End any exposure under way."""
        self._script.release()
        self._script.strike("stop")
        self._camera.stop()

    def _spoilt(self, frame: Frame, fault: Fault) -> Frame:
        camera = self._camera.describe()
        if fault.effect == "stale_frame" and self._last is not None:
            return replace(frame, counts=self._last.counts, exposure_time=self._last.exposure_time)
        if fault.effect == "torn_frame":
            return replace(frame, counts=frame.counts[: frame.counts.shape[0] // 2])
        if fault.effect == "clipped_frame":
            return replace(frame, counts=np.full_like(frame.counts, round(camera.saturation_level)))
        if fault.effect == "black_frame":
            return replace(frame, counts=np.full_like(frame.counts, round(camera.black_level)))
        return frame


class FaultyLight:
    """A light that follows a script."""

    def __init__(self, light: Light, script: FaultScript) -> None:
        self._light, self._script = light, script
        self._serial_number = ""

    def connect(self) -> None:
        """Open the device, dark; safe to call twice."""
        self._script.strike("connect")
        self._light.connect()

    def disconnect(self) -> None:
        """Switch off and close; safe to call twice, and without `connect`."""
        self._script.strike("disconnect")
        self._light.disconnect()

    def describe(self) -> LightDescription:
        """Return what the light is."""
        fault = self._script.strike("describe")
        if fault is not None and fault.effect == "other_serial":
            self._serial_number = "another light"
        description = self._light.describe()
        return replace(description, serial_number=self._serial_number or description.serial_number)

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine, or do what the script says."""
        fault = self._script.strike("on")
        effect = "" if fault is None else fault.effect
        if effect == "stays_dark":
            return self._light.off()
        state = self._light.on(level, max_seconds)
        if effect == "dead":
            self._script.world.lamp.gain = 0.0
            return replace(state, monitor=0.0)
        if fault is not None and effect == "drift":
            self._script.world.lamp.gain *= 1.0 + fault.value
        return state

    def off(self) -> LightState:
        """Go dark, or do what the script says."""
        fault = self._script.strike("off")
        effect = "" if fault is None else fault.effect
        if effect == "stays_on":
            return self._light.read()
        if effect == "stuck":
            return replace(self._light.read(), lit=False, level=0.0)
        return self._light.off()

    def read(self) -> LightState:
        """Return the state as the device reports it."""
        self._script.strike("read")
        return self._light.read()


class FaultyStage:
    """A stage that follows a script."""

    def __init__(self, stage: Stage, script: FaultScript) -> None:
        self._stage, self._script = stage, script
        self._serial_number = ""
        self._alarmed = False

    def connect(self) -> None:
        """Open the device, at rest; safe to call twice."""
        self._script.strike("connect")
        self._stage.connect()

    def disconnect(self) -> None:
        """Stop and close; safe to call twice, and without `connect`."""
        self._script.strike("disconnect")
        self._stage.disconnect()

    def describe(self) -> StageDescription:
        """Return what the stage is."""
        fault = self._script.strike("describe")
        if fault is not None and fault.effect == "other_serial":
            self._serial_number = "another stage"
        description = self._stage.describe()
        return replace(description, serial_number=self._serial_number or description.serial_number)

    def home(self) -> None:
        """Find the zero of every axis; clears an alarm."""
        self._script.strike("home")
        self._alarmed = False
        self._stage.home()

    def move(self, target: Mapping[str, float]) -> dict[str, float]:
        """Move, or do what the script says."""
        fault = self._script.strike("move")
        if fault is not None and fault.effect == "alarm":
            self._alarmed = True
        if self._alarmed:
            raise DeviceError("the simulated stage hit the limit switch of an axis and is locked. Home it")
        if fault is not None and fault.effect == "stall":
            here = self._stage.read()
            self._stage.move({name: 0.5 * (here[name] + value) for name, value in target.items()})
            self._script.world.clock.sleep(_ANSWER_LIMIT)
            raise DeviceTimeoutError("the simulated stage stalled: it did not arrive within its time limit")
        if fault is not None and fault.effect == "slip":
            return self._stage.move({name: value - fault.value for name, value in target.items()})
        return self._stage.move(target)

    def move_duration(self, target: Mapping[str, float]) -> float:
        """Return the seconds that `move` would take from here."""
        return self._stage.move_duration(target)

    def read(self) -> dict[str, float]:
        """Return the position of every axis as the device reports it."""
        self._script.strike("read")
        return self._stage.read()

    def stop(self) -> None:
        """Halt every axis now."""
        self._script.release()
        self._script.strike("stop")
        self._stage.stop()
