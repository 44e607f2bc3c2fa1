import pytest

from drivers.errors import DeviceError, DriverNotFoundError, NotSafeError, UnsafeError
from drivers.registry import open_devices
from instrument.rig.rig import Rig
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
    assert caught.value.__notes__ == ["NOT SAFE: light off failed: light.off failed at call 4"]
    assert bench.calls[5:7] == ["stage.stop", "camera.stop"]


def test_an_error_that_is_told_in_words_is_told_with_what_is_not_safe() -> None:
    """Nobody would see its notes, and the light comes first."""
    bench = FakeBench(fault_at({4}, DeviceError))
    said = r"^the camera is gone\. NOT SAFE: light off failed: light\.off failed at call 4$"
    with pytest.raises(NotSafeError, match=said), Rig.open(rig_config(), bench.devices):
        raise DeviceError("the camera is gone")


def test_a_light_that_cannot_be_switched_off_is_an_error_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeLight, "off", FakeLight.read)
    with pytest.raises(DeviceError, match="switch it off by hand"), Rig.open(rig_config(), FakeBench().devices) as rig:
        rig.light.on(0.5, 1.0)


def test_an_unknown_driver_is_refused_with_the_known_ones() -> None:
    with pytest.raises(DriverNotFoundError) as caught:
        open_devices(table(camera="genicam", light="skpi", stage="grbl"))
    assert str(caught.value) == (
        "light.driver is 'skpi'; known drivers of a light: simulated, scpi, serial. Did you mean 'scpi'?"
    )


def test_a_rig_that_mixes_simulated_and_real_devices_is_refused() -> None:
    with pytest.raises(DeviceError, match=r"mixes simulated .camera, light. and real devices .stage = 'grbl'."):
        open_devices(table(stage="grbl"))


def test_every_device_that_does_not_connect_is_named() -> None:
    bench = FakeBench(fault_at({0, 2}, DeviceError))
    with pytest.raises(DeviceError) as caught, Rig.open(rig_config(), bench.devices):
        pytest.fail("entered")
    assert str(caught.value).splitlines() == [
        "2 devices cannot be used:",
        "  light: light.connect failed at call 0",
        "  camera: camera.connect failed at call 2",
    ]
    assert "stage.disconnect" in bench.calls


def test_a_device_that_does_harm_is_not_tried_again_though_others_fail_too() -> None:
    def smoke(number: int, name: str) -> None:
        fault_at({0}, UnsafeError)(number, name)
        fault_at({1}, DeviceError)(number, name)

    with pytest.raises(UnsafeError, match="2 devices"), Rig.open(rig_config(), FakeBench(smoke).devices):
        pytest.fail("entered")


def test_the_simulated_devices_open_by_name() -> None:
    with Rig.open(rig_config()) as rig:
        assert rig.camera.describe().width == 24
