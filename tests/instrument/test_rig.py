import pytest

from drivers import registry
from drivers.errors import DeviceError, DriverNotFoundError
from drivers.registry import open_devices
from instrument.rig import Rig
from tests.protocols.fakes import FakeBench, FakeLight, fault_at, rig_config


def table(**drivers: str) -> dict[str, dict[str, str]]:
    return {kind: {"driver": drivers.get(kind, "simulated")} for kind in ("camera", "light", "stage")}


def test_entering_connects_and_homes_and_leaving_is_dark_stopped_and_disconnected() -> None:
    bench = FakeBench()
    with Rig.open(rig_config(), bench.devices) as rig:
        assert bench.calls == ["light.connect", "stage.connect", "camera.connect", "stage.home"]
        rig.light.on(0.5, 1.0)
    assert bench.calls[5:] == [
        "light.off", "stage.stop", "camera.stop",
        "camera.disconnect", "stage.disconnect", "light.disconnect",
    ]  # fmt: skip
    assert not bench.lit


@pytest.mark.parametrize("number", [0, 1, 2])
def test_all_devices_are_connected_or_none(number: int) -> None:
    bench = FakeBench(fault_at({number}, DeviceError))
    with pytest.raises(DeviceError, match=r"connect failed at call"), Rig.open(rig_config(), bench.devices):
        pytest.fail("entered")
    assert "light.disconnect" in bench.calls
    assert "stage.home" not in bench.calls


def test_every_device_is_made_safe_though_the_first_fails_and_the_first_error_is_the_message() -> None:
    bench = FakeBench(fault_at({4}, DeviceError))
    with pytest.raises(ZeroDivisionError) as caught, Rig.open(rig_config(), bench.devices):
        _ = 1 / 0
    assert caught.value.__notes__ == ["light off failed: light.off failed at call 4"]
    assert bench.calls[5:7] == ["stage.stop", "camera.stop"]


def test_a_light_that_cannot_be_switched_off_is_an_error_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeLight, "off", FakeLight.read)
    with pytest.raises(DeviceError, match="switch it off by hand"), Rig.open(rig_config(), FakeBench().devices) as rig:
        rig.light.on(0.5, 1.0)


def test_an_unknown_driver_is_refused_with_the_known_ones() -> None:
    with pytest.raises(DriverNotFoundError) as caught:
        open_devices(table(light="simulatd"))
    assert str(caught.value) == (
        "light.driver is 'simulatd'; known drivers of a light: simulated. Did you mean 'simulated'?"
    )


def test_a_rig_that_mixes_simulated_and_real_devices_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "KNOWN_DRIVERS", dict.fromkeys(registry.KINDS, ("simulated", "grbl")))
    with pytest.raises(DeviceError, match=r"mixes simulated .camera, light. and real devices .stage = 'grbl'."):
        open_devices(table(stage="grbl"))


def test_the_simulated_devices_open_by_name() -> None:
    with Rig.open(rig_config()) as rig:
        assert rig.camera.describe().width == 24
