"""What is attached, and whether it can be used."""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial

from drivers import discovery, registry
from drivers.device_settings import DeviceSettings
from drivers.driver import DeviceState, Driver, FoundDevice
from drivers.errors import DriverNotFoundError
from drivers.scpi_light.discovery import find_instruments
from drivers.serial_link.discovery import find_serial_ports
from tests.drivers.lights.dc2200_double import Dc2200Double
from tests.drivers.lights.usbtmc_double import UsbBus, UsbTmcDevice


@pytest.fixture
def usb() -> UsbTmcDevice:
    return UsbTmcDevice(Dc2200Double())


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> str:
    _, slave = os.openpty()
    name = os.ttyname(slave)
    os.close(slave)
    uno = SimpleNamespace(
        device=name, hwid="USB VID:PID=2341:0043", manufacturer="Arduino", product="Uno", serial_number="7543"
    )
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [uno])
    return name


def states(found: list[FoundDevice]) -> list[DeviceState]:
    return [device.state for device in found]


def test_a_controller_that_can_be_used_is_found_and_left_as_it_was(usb: UsbTmcDevice):
    (found,) = find_instruments(UsbBus(usb))
    assert (found.state, found.remedy) == (DeviceState.FOUND, "")
    assert "M00000001" in found.name
    assert "1313:80c8" in found.where
    assert (usb.n_open, usb.claimed) == (0, False)


def test_a_controller_that_the_kernel_has_is_found_since_it_lets_go(usb: UsbTmcDevice):
    usb.kernel_driver = True
    (found,) = find_instruments(UsbBus(usb))
    assert found.state is DeviceState.FOUND
    assert usb.kernel_driver


@pytest.mark.parametrize(
    ("attribute", "number", "state", "remedy"),
    [
        ("open_error", errno.EACCES, DeviceState.NO_PERMISSION, "60-halfangle.rules"),
        ("claim_error", errno.EBUSY, DeviceState.BUSY, "end that"),
    ],
)
def test_a_controller_that_cannot_be_used_comes_with_its_remedy(
    usb: UsbTmcDevice, attribute: str, number: int, state: DeviceState, remedy: str
):
    setattr(usb, attribute, number)
    (found,) = find_instruments(UsbBus(usb))
    assert found.state is state
    assert remedy in found.remedy
    assert usb.n_open == 0


def test_another_instrument_is_unknown_and_no_other_device_is_one():
    meter = UsbTmcDevice(Dc2200Double(), ids=(0x1234, 0x5678))
    keyboard = UsbTmcDevice(Dc2200Double(), ids=(0x046D, 0xC31C))
    keyboard.interface_class = 0x03
    (found,) = find_instruments(UsbBus(meter, keyboard))
    assert found.state is DeviceState.UNKNOWN
    assert "vendor_id" in found.remedy


def test_a_serial_port_is_listed_unopened_since_what_is_there_is_unknown(port: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(os, "open", lambda *_: pytest.fail("a port was opened"))
    (found,) = find_serial_ports()
    assert (found.name, found.where, found.state) == ("Arduino Uno 7543", port, DeviceState.UNKNOWN)
    assert "halfangle rig check" in found.remedy


def test_a_port_that_is_open_elsewhere_is_busy_and_says_where(port: str):
    with serial.Serial(port):
        (found,) = find_serial_ports()
    assert found.state is DeviceState.BUSY
    assert f"process {os.getpid()}" in found.remedy


def test_a_port_that_may_not_be_opened_needs_a_permission(port: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    (found,) = find_serial_ports()
    assert found.state is DeviceState.NO_PERMISSION
    assert "dialout" in found.remedy


def test_ports_without_hardware_behind_them_are_left_out(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [SimpleNamespace(device="/dev/ttyS0", hwid="n/a")])
    assert list(find_serial_ports()) == []


def finds(*devices: FoundDevice) -> Callable[..., Driver]:
    return lambda kind, _: Driver(kind, DeviceSettings, lambda *_: None, lambda: devices)


def test_what_is_found_names_the_driver_and_what_cannot_be_looked_for_the_reason(monkeypatch: pytest.MonkeyPatch):
    led = FoundDevice("LED", "gpio 4", DeviceState.FOUND)
    other = FoundDevice("meter", "usb 1-2", DeviceState.UNKNOWN)

    def driver(kind, name):
        if name == "broken":
            raise DriverNotFoundError("its package is missing")
        return finds(led, other)(kind, name)

    monkeypatch.setattr(discovery, "driver_names", lambda: iter([("light", "led"), ("camera", "broken")]))
    monkeypatch.setattr(discovery, "find_driver", driver)
    monkeypatch.setattr(discovery, "find_serial_ports", lambda: iter(()))
    found = discovery.discover()
    assert [(device.name, device.kind, device.driver) for device in found.devices] == [
        ("LED", "light", "led"),
        ("meter", "", ""),
    ]
    assert found.not_looked_for == ["camera.broken: its package is missing"]


def test_every_driver_that_is_named_can_be_loaded_and_is_of_its_kind():
    for kind, name in registry.driver_names():
        assert registry.find_driver(kind, name).kind == kind


def test_the_udev_rules_are_shipped_with_the_drivers():
    assert (Path(registry.__file__).parent / "udev" / "60-halfangle.rules").is_file()
