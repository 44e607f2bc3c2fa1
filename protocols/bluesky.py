"""A rig as devices for bluesky, the orchestrator of large facilities.

Nothing here needs bluesky. The light is no device of its own: it shines within `FacilityBracket.trigger`, under a
lease, so that a run that is paused and resumed can never take a frame in the dark.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from threading import Event, Lock, Thread
from typing import Any

import numpy as np

from drivers.stage import AxisDescription
from instrument.rig.rig import Rig
from protocols.acquisition.bracket import Bracket, take_bracket
from protocols.acquisition.shot import Shot

Reading = dict[str, dict[str, Any]]

SOURCE = "halfangle"


class ActionStatus:
    """An action that runs in a thread of its own, and how it ended.

    Parameters
    ----------
    act : callable
        What to do; an error of it becomes the status' exception.
    """

    def __init__(self, act: Callable[[], object]) -> None:
        self._finished, self._lock = Event(), Lock()
        self._error: BaseException | None = None
        self._callbacks: list[Callable[[ActionStatus], None]] = []
        Thread(target=self._run, args=(act,), daemon=True).start()

    @property
    def done(self) -> bool:
        """Whether it ended."""
        return self._finished.is_set()

    @property
    def success(self) -> bool:
        """Whether it ended well."""
        return self.done and self._error is None

    def add_callback(self, callback: Callable[[ActionStatus], None]) -> None:
        """Call `callback` with this status when it ends; at once if it has."""
        with self._lock:
            if not self.done:
                self._callbacks.append(callback)
                return
        callback(self)

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """Return the error it ended with, None if there was none; wait for it for `timeout` seconds.

        Raises
        ------
        TimeoutError
            If it has not ended by then.
        """
        if not self._finished.wait(timeout):
            raise TimeoutError("the action has not ended yet")
        return self._error

    def _run(self, act: Callable[[], object]) -> None:
        try:
            act()
        except BaseException as error:
            self._error = error
        with self._lock:
            self._finished.set()
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            callback(self)


class FacilityAxis:
    """One axis of the stage: movable, readable, stoppable, checkable.

    Parameters
    ----------
    rig : Rig
        Connected.
    axis : AxisDescription
    """

    parent = None

    def __init__(self, rig: Rig, axis: AxisDescription) -> None:
        self._rig, self._axis = rig, axis
        self._wanted = rig.stage.read()[axis.name]

    @property
    def name(self) -> str:
        """Of the axis."""
        return self._axis.name

    @property
    def hints(self) -> dict[str, list[str]]:
        """The field to plot."""
        return {"fields": [self.name]}

    def check_value(self, value: float) -> None:
        """Raise `DeviceLimitError` if the axis may not go to `value` (degrees or mm)."""
        self._axis.soft_limits.check(f"target of axis {self.name}", value, "Leave that pose out of the plan.")

    def set(self, value: float) -> ActionStatus:
        """Move to `value`, degrees or mm."""
        self.check_value(value)
        self._wanted = value
        return ActionStatus(lambda: self._rig.stage.move({self.name: value}))

    def locate(self) -> dict[str, float]:
        """Return where it should be and where it is."""
        return {"setpoint": self._wanted, "readback": self._rig.stage.read()[self.name]}

    def read(self) -> Reading:
        """Return the read-back."""
        return {self.name: _now(self._rig.stage.read()[self.name])}

    def describe(self) -> Reading:
        """Return what `read` gives."""
        return {self.name: {**_number(), "units": self._axis.soft_limits.unit}}

    def read_configuration(self) -> Reading:
        """Return tolerance and limits."""
        limits = self._axis.soft_limits
        values = {"tolerance": self._axis.tolerance, "low": limits.low, "high": limits.high}
        return {f"{self.name}_{key}": _now(value) for key, value in values.items()}

    def describe_configuration(self) -> Reading:
        """Return what `read_configuration` gives."""
        return {key: _number() for key in self.read_configuration()}

    def stop(self, success: bool = True) -> None:
        """Halt the stage now."""
        self._rig.stage.stop()


class FacilityBracket:
    """Camera and light as one detector: a trigger is a bracket in the light, which is dark before and after.

    Parameters
    ----------
    rig : Rig
        Connected.
    bracket : Bracket
    name : str
    """

    parent = None

    def __init__(self, rig: Rig, bracket: Bracket, name: str = "bracket") -> None:
        self._rig, self._bracket, self._name = rig, bracket, name
        self._shots: list[Shot] = []

    @property
    def name(self) -> str:
        """Of the detector."""
        return self._name

    @property
    def hints(self) -> dict[str, list[str]]:
        """The field to plot."""
        return {"fields": [f"{self.name}_mean"]}

    def stage(self) -> list[Any]:
        """Make the rig safe before the run."""
        self._rig.safe()
        return [self]

    def unstage(self) -> list[Any]:
        """Make it safe after the run."""
        self._rig.safe()
        return [self]

    def pause(self) -> None:
        """Go dark; the bracket that was interrupted is taken again as a whole."""
        self._rig.safe()

    def resume(self) -> None:
        """Do nothing: each bracket brings its own light."""

    def stop(self, success: bool = True) -> None:
        """Go dark now and end the exposure."""
        self._rig.safe()

    def trigger(self) -> ActionStatus:
        """Take the bracket."""
        return ActionStatus(self._take)

    def read(self) -> Reading:
        """Return the frames (E, H, W) of the last bracket, their exposure times, means, and the light's monitor."""
        frames = np.stack([shot.frame.counts for shot in self._shots])
        values = {
            "frames": frames,
            "mean": frames.mean(axis=(1, 2)),
            "exposure_time": np.array([shot.frame.exposure_time for shot in self._shots]),
            "monitor": np.array([shot.light.monitor for shot in self._shots]),
        }
        return {f"{self.name}_{key}": _now(value) for key, value in values.items()}

    def describe(self) -> Reading:
        """Return what `read` gives."""
        camera, n = self._rig.camera.describe(), len(self._bracket.times)
        shapes = {"frames": [n, camera.height, camera.width], "mean": [n], "exposure_time": [n], "monitor": [n]}
        types = {"frames": "<u2"}
        return {
            f"{self.name}_{key}": {
                "source": SOURCE,
                "dtype": "array",
                "shape": shape,
                "dtype_numpy": types.get(key, "<f8"),
            }
            for key, shape in shapes.items()
        }

    def read_configuration(self) -> Reading:
        """Return serial numbers, levels and the light's level."""
        camera = self._rig.camera.describe()
        values: Mapping[str, Any] = {
            "camera_serial_number": camera.serial_number,
            "light_serial_number": self._rig.light.describe().serial_number,
            "black_level": camera.black_level,
            "saturation_level": camera.saturation_level,
            "light_level": self._rig.config.light.level,
        }
        return {f"{self.name}_{key}": _now(value) for key, value in values.items()}

    def describe_configuration(self) -> Reading:
        """Return what `read_configuration` gives."""
        return {
            key: _number() if isinstance(reading["value"], float) else {**_number(), "dtype": "string"}
            for key, reading in self.read_configuration().items()
        }

    def _take(self) -> None:
        self._shots = take_bracket(self._rig, self._bracket)


def facility_axes(rig: Rig) -> dict[str, FacilityAxis]:
    """Return the axes of a connected rig by name."""
    return {axis.name: FacilityAxis(rig, axis) for axis in rig.stage.describe().axes}


def _number() -> dict[str, Any]:
    return {"source": SOURCE, "dtype": "number", "shape": []}


def _now(value: Any) -> dict[str, Any]:
    return {"value": value, "timestamp": time.time()}
