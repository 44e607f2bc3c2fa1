"""The simulated camera."""

from __future__ import annotations

from collections import Counter
from threading import Event

import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription, Frame
from drivers.clock import sleep_unless
from drivers.errors import DeviceError
from drivers.limits import Limits
from drivers.simulated.seeding import position_key, rng_for
from drivers.simulated.sensor import mosaic
from drivers.simulated.world import World

_EXPOSURE_TIME_LIMITS = Limits(1e-5, 10.0, "s")
_TICK = 1e-6
_FIRST_EXPOSURE_TIME = 0.010

_Spot = tuple[int, ...]


class SimulatedCamera:
    """A camera that looks at a simulated world.

    Parameters
    ----------
    world : World
        Shared with the light and the stage.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._connected = False
        self._stopped = Event()
        self._exposure_time = _FIRST_EXPOSURE_TIME
        self._n_triggers = 0
        self._repetitions: Counter[tuple[int, ...]] = Counter()
        self._arrivals_seen = -1
        self._spot: _Spot | None = None
        self._rate = np.zeros((0, 0), dtype=np.float32)
        self._response = np.ones((0, 0), dtype=np.float32)

    def connect(self) -> None:
        """Open the device; safe to call twice."""
        if self._connected:
            return
        bench = self._world.bench
        rng = rng_for(bench.simulation.seed, "pixel response")
        self._response = self._world.sensor.pixel_response(rng, bench.height, bench.width)
        self._n_triggers = 0
        self._connected = True

    def disconnect(self) -> None:
        """Close the device; safe to call twice, and without `connect`."""
        self.stop()
        self._connected = False

    def describe(self) -> CameraDescription:
        """Return what the camera is."""
        self._require_connection()
        bench, sensor = self._world.bench, self._world.sensor
        return CameraDescription(
            make="halfangle",
            model="simulated camera",
            serial_number=f"sim-{bench.simulation.seed}",
            height=bench.height,
            width=bench.width,
            bit_depth=sensor.bit_depth,
            black_level=sensor.black_level,
            saturation_level=sensor.saturation_level,
            bayer_pattern=sensor.bayer_pattern,
            conversion_gain=sensor.conversion_gain,
            read_noise=sensor.read_noise,
            exposure_time_limits=_EXPOSURE_TIME_LIMITS,
        )

    def set_exposure_time(self, exposure_time: float) -> float:
        """Set the exposure time in seconds; return it as rounded to the camera's microseconds.

        Raises
        ------
        DeviceLimitError
            If the camera cannot take that exposure time.
        """
        self._require_connection()
        remedy = "Drop that step from the bracket or change the aperture."
        _EXPOSURE_TIME_LIMITS.check("exposure_time", exposure_time, remedy)
        self._exposure_time = round(exposure_time / _TICK) * _TICK
        return self._exposure_time

    def trigger(self) -> Frame:
        """Expose once and return the frame."""
        self._require_connection()
        self._stopped.clear()
        lamp, exposure_time = self._world.lamp, self._exposure_time
        # A lease that ends while the shutter is open leaves the rest of the exposure dark.
        lit = lamp.power * min(lamp.remaining, exposure_time)
        if not sleep_unless(self._stopped, self._world.clock, exposure_time):
            raise DeviceError("the exposure was stopped. Trigger again for a frame.")
        expected = self._photoelectrons(lit)
        counts = self._world.sensor.counts(expected, exposure_time, self._noise(lit > 0.0))
        frame = Frame(counts, self._n_triggers, exposure_time, self._world.sensor.temperature)
        self._n_triggers += 1
        return frame

    def stop(self) -> None:
        """End any exposure under way; safe to call at any time."""
        self._stopped.set()

    def _require_connection(self) -> None:
        if not self._connected:
            raise DeviceError("the simulated camera is not connected. Call connect() first.")

    def _photoelectrons(self, lit: float) -> NDArray[np.float32]:
        """Return expected electrons, shape (height, width), for `lit` seconds at full power."""
        if lit <= 0.0:
            return np.zeros_like(self._response)
        spot = position_key(self._world.position)
        if spot != self._spot:
            # The picture for light of power 1 serves every exposure of a bracket.
            sensitivity = self._world.sensor.sensitivity(self._world.bench.working_distance_mm)
            self._rate = np.float32(sensitivity) * mosaic(self._world.picture()) * self._response
            self._spot = spot
        return np.float32(lit * self._world.light_power()) * self._rate

    def _noise(self, lit: bool) -> np.random.Generator:
        """Return the generator of this frame: named by place, exposure and how often since arriving."""
        if self._arrivals_seen != self._world.n_arrivals:
            self._repetitions.clear()
            self._arrivals_seen = self._world.n_arrivals
        key = (round(self._exposure_time / _TICK), int(lit))
        repetition = self._repetitions[key]
        self._repetitions[key] += 1
        spot = position_key(self._world.position)
        return rng_for(self._world.bench.simulation.seed, "frame", *key, repetition, *spot)
