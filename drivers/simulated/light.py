"""The simulated light."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.errors import DeviceError
from drivers.lease import LEVEL_LIMITS, check_lease, check_level
from drivers.light import LightDescription, LightState

if TYPE_CHECKING:
    # The process that supervises a light has no use for the scene.
    from drivers.simulated.world import World


class SimulatedLight:
    """A light that shines on a simulated world.

    Parameters
    ----------
    world : World
        Shared with the camera and the stage.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._connected = False

    def connect(self) -> None:
        """Open the device, dark; safe to call twice."""
        if not self._connected:
            self._world.lamp.darken()
        self._connected = True

    def disconnect(self) -> None:
        """Switch off and close; safe to call twice, and without `connect`."""
        self._world.lamp.darken()
        self._connected = False

    def describe(self) -> LightDescription:
        """Return what the light is."""
        self._require_connection()
        seed = self._world.bench.simulation.seed
        return LightDescription("halfangle", "simulated light", f"sim-{seed}", LEVEL_LIMITS)

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine at `level` for at most `max_seconds`, then go dark unless told again.

        Raises
        ------
        DeviceLimitError
            If `level` is outside the limits or `max_seconds` is not positive and finite.
        """
        self._require_connection()
        check_level(level)
        check_lease(max_seconds)
        self._world.lamp.shine(level, max_seconds)
        return self._state()

    def off(self) -> LightState:
        """Go dark and confirm it; safe to call at any time."""
        self._world.lamp.darken()
        return self._state()

    def read(self) -> LightState:
        """Return the state as the device reports it."""
        self._require_connection()
        return self._state()

    def _require_connection(self) -> None:
        if not self._connected:
            raise DeviceError("the simulated light is not connected. Call connect() first.")

    def _state(self) -> LightState:
        lamp = self._world.lamp
        # The photodiode sits in the lamp: it sees the drift, not how much leaves at this pose.
        return LightState(lamp.level > 0.0, lamp.level, lamp.power, lamp.temperature)
