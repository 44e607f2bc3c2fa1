"""What every light keeps, simulated or not."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from drivers.errors import DeviceError, DeviceLimitError
from drivers.light import Light


class LightContract:
    """Subclass it, and give fixtures `light` (not yet connected) and `wait` (lets seconds pass)."""

    @pytest.fixture
    def connected(self, light: Light) -> Iterator[Light]:
        light.connect()
        yield light
        light.disconnect()

    @pytest.fixture
    def lease(self) -> float:
        """Seconds; longer where they pass on the computer's clock, which does not wait for a busy computer."""
        return 0.5

    def test_satisfies_the_protocol(self, light: Light) -> None:
        assert isinstance(light, Light)

    def test_refuses_to_work_before_it_is_connected(self, light: Light) -> None:
        for act in (light.describe, light.read, lambda: light.on(1.0, 1.0)):
            with pytest.raises(DeviceError, match="not connected"):
                act()

    def test_connects_and_disconnects_twice_without_complaint(self, light: Light) -> None:
        light.disconnect()
        light.connect()
        light.connect()
        light.disconnect()
        light.disconnect()

    def test_can_be_told_to_go_dark_at_any_time(self, light: Light) -> None:
        assert not light.off().lit
        light.connect()
        light.on(1.0, 10.0)
        light.disconnect()
        assert not light.off().lit

    def test_is_dark_when_it_connects(self, connected: Light) -> None:
        assert not connected.read().lit

    def test_shines_at_the_level_it_is_told(self, connected: Light) -> None:
        state = connected.on(0.5, 10.0)
        assert state.lit
        assert state.level == pytest.approx(0.5, abs=0.01)
        assert connected.read().lit

    def test_confirms_that_it_is_dark(self, connected: Light) -> None:
        connected.on(1.0, 10.0)
        assert not connected.off().lit
        assert not connected.off().lit
        assert not connected.read().lit

    def test_is_dark_after_it_reconnects(self, connected: Light) -> None:
        connected.on(1.0, 10.0)
        connected.disconnect()
        connected.connect()
        assert not connected.read().lit

    def test_goes_dark_by_itself_when_its_lease_ends(
        self, connected: Light, wait: Callable[[float], None], lease: float
    ) -> None:
        connected.on(1.0, lease)
        wait(0.6 * lease)
        assert connected.read().lit
        wait(0.6 * lease)
        assert not connected.read().lit

    def test_shines_on_when_the_lease_is_renewed(
        self, connected: Light, wait: Callable[[float], None], lease: float
    ) -> None:
        connected.on(1.0, lease)
        wait(0.6 * lease)
        connected.on(1.0, lease)
        wait(0.6 * lease)
        assert connected.read().lit

    @pytest.mark.parametrize("level", [-0.1, 1.1, float("nan")])
    def test_refuses_a_level_outside_its_limits_and_stays_dark(self, connected: Light, level: float) -> None:
        with pytest.raises(DeviceLimitError, match=r"level is .* allowed is 0 to 1"):
            connected.on(level, 1.0)
        assert not connected.read().lit

    @pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), float("inf")])
    def test_refuses_a_lease_that_never_ends_or_never_begins(self, connected: Light, seconds: float) -> None:
        with pytest.raises(DeviceLimitError, match="max_seconds"):
            connected.on(1.0, seconds)
        assert not connected.read().lit
