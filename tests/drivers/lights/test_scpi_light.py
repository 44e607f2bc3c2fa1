"""A LED controller on a USB bus that fails in every way that a bus does."""

import errno
import struct
import sys
import time
from array import array
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest
import usb.core

from drivers.errors import (
    DeviceError,
    DeviceLimitError,
    DeviceLostError,
    DeviceTimeoutError,
    DriverNotFoundError,
    UnsafeError,
)
from drivers.limits import Limits
from drivers.scpi_light.light import ScpiLight
from drivers.scpi_light.settings import ScpiLightSettings, UsbAddress
from drivers.scpi_light.transport import UsbTmc
from drivers.scpi_light.usb_errors import UDEV_RULES
from drivers.simulated.clock import VirtualClock
from drivers.supervised_light import SupervisedLight
from tests.drivers.double_clock import until
from tests.drivers.lights.dc2200_double import Dc2200Double
from tests.drivers.lights.test_supervised_light import ROOT
from tests.drivers.lights.usbtmc_double import UsbBus, UsbTmcDevice

SETTINGS = ScpiLightSettings(max_current_a=1.0)


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def controller(clock: VirtualClock) -> Dc2200Double:
    return Dc2200Double(clock.now)


@pytest.fixture
def device(controller: Dc2200Double) -> UsbTmcDevice:
    return UsbTmcDevice(controller)


@pytest.fixture
def light(device: UsbTmcDevice) -> ScpiLight:
    return ScpiLight(SETTINGS, "", UsbBus(device))


def test_says_what_the_controller_is(light: ScpiLight) -> None:
    light.connect()
    description = light.describe()
    assert (description.make, description.model) == ("Thorlabs", "DC2200")
    assert (description.serial_number, description.firmware) == ("M00000001", "1.4.0")
    light.disconnect()


def test_connecting_darkens_a_light_that_somebody_left_on(light: ScpiLight, controller: Dc2200Double) -> None:
    assert controller.lit
    light.connect()
    assert not controller.lit


def test_connecting_sets_the_current_limit_and_the_terminal(light: ScpiLight, controller: Dc2200Double) -> None:
    controller.limit, controller.terminal = 3.5, 2
    light.connect()
    assert (controller.limit, controller.terminal) == (1.0, 1)


def test_a_current_limit_that_was_raised_on_the_panel_is_lowered_before_it_shines(
    light: ScpiLight, controller: Dc2200Double
) -> None:
    light.connect()
    controller.limit = 4.0
    light.on(1.0, 1.0)
    assert controller.limit == 1.0


def test_a_current_limit_that_holds_is_not_written_again(light: ScpiLight, controller: Dc2200Double) -> None:
    controller.limit = 3.5
    light.connect()
    for _ in range(5):
        light.on(0.5, 1.0)
    assert controller.n_limits_set == 1


def test_a_current_that_the_controller_refuses_is_said_with_its_reason(device: UsbTmcDevice) -> None:
    light = ScpiLight(ScpiLightSettings(max_current_a=9.0), "", UsbBus(device))
    with pytest.raises(DeviceError, match=r"refuses the current limit = 9 A: error -222, Data out of range"):
        light.connect()
    assert device.n_open == 0


@pytest.mark.parametrize("name", ["limit", "brightness", "on_time", "off_time", "count"])
def test_a_setting_that_does_not_hold_is_found_by_its_read_back(
    light: ScpiLight, controller: Dc2200Double, name: str
) -> None:
    light.connect()
    setattr(controller, name, 0.77)
    controller.stuck = {name}
    with pytest.raises(DeviceError, match=r"was set to .* and is read back as 0\.77"):
        light.on(0.5, 2.0)
    assert controller.n_switched_on == 0


@pytest.mark.parametrize("seconds", [0.5, 9.99, 10.0, 25.0, 120.0])
def test_the_controller_ends_the_lease_by_itself_even_when_the_cable_is_out(
    light: ScpiLight, controller: Dc2200Double, device: UsbTmcDevice, clock: VirtualClock, seconds: float
) -> None:
    light.connect()
    assert light.on(0.5, seconds).lit
    device.plugged_in = False
    clock.sleep(0.99 * seconds)
    assert controller.lit
    clock.sleep(0.01 * seconds + 0.001)
    assert not controller.lit


def test_a_lease_longer_than_the_settings_allow_is_refused(light: ScpiLight, controller: Dc2200Double) -> None:
    light.connect()
    with pytest.raises(DeviceLimitError, match=r"max_seconds is 301 s; allowed is up to 300 s\. Shorten the bracket"):
        light.on(0.5, 301.0)
    assert not controller.lit


def test_level_zero_is_dark(light: ScpiLight, controller: Dc2200Double) -> None:
    light.connect()
    assert not light.on(0.0, 1.0).lit
    assert controller.n_switched_on == 0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("interlock_open", "its interlock is open. Close it"),
        ("driver_hot", "it is too hot"),
        ("head_hot", "its LED head is too hot"),
        ("limit_tripped", "its current limit tripped"),
    ],
)
def test_a_protection_that_tripped_is_named(
    light: ScpiLight, controller: Dc2200Double, name: str, message: str
) -> None:
    light.connect()
    setattr(controller, name, True)
    with pytest.raises(UnsafeError, match=message):
        light.on(0.5, 1.0)
    assert controller.n_switched_on == 0


def test_a_light_that_does_not_go_off_is_said_to_be_lit(light: ScpiLight, controller: Dc2200Double) -> None:
    light.connect()
    light.on(1.0, 10.0)
    controller.sticks_on = True
    assert light.off().lit


def test_a_light_that_cannot_be_darkened_is_not_connected(device: UsbTmcDevice, controller: Dc2200Double) -> None:
    controller.sticks_on = True
    with pytest.raises(UnsafeError, match=r"does not go off\. Switch it off by hand"):
        ScpiLight(SETTINGS, "", UsbBus(device)).connect()
    assert device.n_open == 0


def test_no_device_says_what_was_looked_for_and_what_was_found() -> None:
    other = UsbTmcDevice(Dc2200Double(), ids=(0x0957, 0x0407))
    with pytest.raises(DeviceError, match=r"no USB device 1313:80c8; found: 0957:0407\. Look at its cable"):
        ScpiLight(SETTINGS, "", UsbBus(other)).connect()
    with pytest.raises(DeviceError, match="found: no USB device at all"):
        ScpiLight(SETTINGS, "", UsbBus()).connect()


def test_another_serial_number_is_another_device(device: UsbTmcDevice) -> None:
    with pytest.raises(DeviceError, match=r"no USB device 1313:80c8, serial number M00000002; found: .*M00000001"):
        ScpiLight(SETTINGS, "M00000002", UsbBus(device)).connect()
    assert device.n_open == 0


def test_of_two_controllers_the_serial_number_chooses() -> None:
    first = UsbTmcDevice(Dc2200Double())
    second = UsbTmcDevice(Dc2200Double(identity="Thorlabs,DC2200,M00000002,1.4.0"), "M00000002")
    bus = UsbBus(first, second)
    with pytest.raises(DeviceError, match=r"2 USB devices .*Set serial_number"):
        ScpiLight(SETTINGS, "", bus).connect()
    light = ScpiLight(SETTINGS, "M00000002", bus)
    light.connect()
    assert light.describe().serial_number == "M00000002"
    assert (first.n_open, second.n_open) == (0, 1)


def test_a_missing_libusb_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def find(**_: object) -> None:
        raise usb.core.NoBackendError("No backend available")

    monkeypatch.setattr(usb.core, "find", find)
    with pytest.raises(DriverNotFoundError, match=r"apt install libusb-1\.0-0"):
        ScpiLight(SETTINGS).connect()


def test_a_missing_pyusb_says_which_extra_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "usb.core", None)
    with pytest.raises(DriverNotFoundError, match=r"needs pyusb\. Install halfangle\[usb\]"):
        ScpiLight(SETTINGS).connect()


def test_a_failure_without_a_name_is_passed_on_in_the_systems_words(device: UsbTmcDevice, light: ScpiLight) -> None:
    device.open_error = errno.ENOMEM
    with pytest.raises(DeviceError, match=r"the USB device 1313:80c8 failed: .*ENOMEM"):
        light.connect()


def test_a_missing_permission_names_the_udev_rule(device: UsbTmcDevice, light: ScpiLight) -> None:
    device.open_error = errno.EACCES
    with pytest.raises(DeviceError, match=r"no permission .*60-halfangle\.rules to /etc/udev/rules\.d"):
        light.connect()


def test_the_udev_rules_name_the_controller() -> None:
    rules = (ROOT / UDEV_RULES).read_text()
    assert f'ATTR{{idVendor}}=="{SETTINGS.vendor_id:04x}", ATTR{{idProduct}}=="{SETTINGS.product_id:04x}"' in rules


def test_a_controller_that_another_process_holds_is_busy(device: UsbTmcDevice, light: ScpiLight) -> None:
    device.kernel_driver = True
    device.claim_error = errno.EBUSY
    with pytest.raises(DeviceError, match="in use by another process"):
        light.connect()
    assert device.n_open == 0
    assert device.kernel_driver


def test_the_kernel_gets_its_device_back(device: UsbTmcDevice, light: ScpiLight) -> None:
    device.kernel_driver = True
    light.connect()
    assert not device.kernel_driver
    light.disconnect()
    assert device.kernel_driver
    assert device.n_open == 0


def test_a_device_of_another_make_is_refused_and_not_switched(controller: Dc2200Double, light: ScpiLight) -> None:
    controller.identity = "ACME,PSU-3000,7,2.0"
    with pytest.raises(DeviceError, match=r"is 'ACME,PSU-3000,7,2\.0'; expected was a DC2200"):
        light.connect()
    assert controller.lit


def test_a_device_that_is_no_usbtmc_device_is_refused(device: UsbTmcDevice, light: ScpiLight) -> None:
    device.interface_class = 0x08
    with pytest.raises(DeviceError, match="is no USBTMC device"):
        light.connect()
    assert device.n_open == 0


def test_an_answer_that_does_not_come_is_a_timeout_and_the_next_one_is_right(
    device: UsbTmcDevice, light: ScpiLight
) -> None:
    light.connect()
    device.mute = True
    with pytest.raises(DeviceTimeoutError, match="did not answer in time"):
        light.read()
    device.mute = False
    assert light.on(0.25, 1.0).level == pytest.approx(0.25)


def test_an_answer_that_the_controller_cannot_take_back_is_read_and_dropped(
    device: UsbTmcDevice, light: ScpiLight
) -> None:
    light.connect()
    device.mute = device.holds_answers = True
    with pytest.raises(DeviceTimeoutError):
        light.read()
    device.mute = False
    assert light.describe().model == "DC2200"
    assert light.on(0.25, 1.0).level == pytest.approx(0.25)


def test_a_controller_that_does_not_clear_is_a_timeout(device: UsbTmcDevice) -> None:
    device.pending_clears = 1_000_000
    light = ScpiLight(ScpiLightSettings(max_current_a=1.0, answer_time_s=0.05), "", UsbBus(device))
    with pytest.raises(DeviceTimeoutError, match=r"does not clear\. Switch it off and on"):
        light.connect()
    assert device.n_open == 0


def test_an_answer_to_another_question_is_no_answer(device: UsbTmcDevice, light: ScpiLight) -> None:
    light.connect()
    device.tag_offset = 1
    with pytest.raises(DeviceError, match="a USBTMC answer to request"):
        light.read()
    device.tag_offset = 0
    assert not light.read().lit


def test_a_controller_that_was_unplugged_is_lost_and_may_be_connected_again(
    device: UsbTmcDevice, light: ScpiLight
) -> None:
    light.connect()
    device.plugged_in = False
    for act in (light.read, lambda: light.on(0.5, 1.0)):
        with pytest.raises(DeviceLostError, match=r"Look at its cable|Connect it again"):
            act()
        assert device.n_open == 0
    assert not light.off().lit  # it was dark, and nothing has reached it since
    device.plugged_in = True
    light.connect()
    assert light.on(0.5, 1.0).lit
    device.plugged_in = False
    for _ in range(2):
        with pytest.raises(DeviceLostError, match="may still shine: switch it off by hand"):
            light.disconnect()


def test_a_controller_that_was_unplugged_is_known_to_be_dark_when_its_pulse_has_ended(
    device: UsbTmcDevice, light: ScpiLight, monkeypatch: pytest.MonkeyPatch
) -> None:
    light.connect()
    light.on(0.5, 1.0)
    device.plugged_in = False
    now = time.monotonic()
    with pytest.raises(DeviceLostError, match="may still shine"):
        light.off()
    monkeypatch.setattr("drivers.lights.led_light.time.monotonic", lambda: now + 3.0)
    assert not light.off().lit


def test_a_controller_that_was_dark_when_it_was_unplugged_is_known_to_be_dark(
    device: UsbTmcDevice, light: ScpiLight
) -> None:
    light.connect()
    light.on(0.5, 1.0)
    light.off()
    device.plugged_in = False
    assert not light.off().lit
    light.disconnect()


def test_an_answer_whose_end_never_comes_is_given_up() -> None:
    transport = UsbTmc(UsbAddress(0x1313, 0x80C8, ""), 0.05)
    told: list[bytes] = []

    def part(size: int, timeout: int) -> Any:
        tag = told[-1][1]
        return array("B", struct.pack("<BBBxIB3x4s", 2, tag, tag ^ 0xFF, 4, 0, b"more"))

    bus = SimpleNamespace(bulk_out=SimpleNamespace(write=lambda data, ms: told.append(data)))
    bus.bulk_in = SimpleNamespace(read=part)
    with pytest.raises(DeviceTimeoutError, match="answers without an end"):
        transport._receive(bus)


def test_a_message_of_many_tags_goes_round(light: ScpiLight) -> None:
    light.connect()
    levels = [light.on(level / 100.0, 1.0).level for level in range(1, 31)]
    assert levels == pytest.approx([level / 100.0 for level in range(1, 31)])


@pytest.mark.parametrize("number", [errno.ETIMEDOUT, errno.ENODEV, errno.EPIPE])
def test_a_failure_of_any_transfer_leaves_the_light_dark_or_its_time_running(number: int) -> None:
    """For every transfer of a session: one clear error, nothing half open, and never a light that stays on."""
    n_transfers = _session(failures={}).n_transfers
    assert n_transfers > 60
    for i_transfer in range(n_transfers):
        device = _session(failures={i_transfer: number})
        assert device.n_open == 0, i_transfer
        assert not device.claimed, i_transfer


def _session(failures: dict[int, int]) -> UsbTmcDevice:
    clock = VirtualClock()
    controller = Dc2200Double(clock.now)
    controller.receive(b"OUTPUT1:STATE OFF")
    device = UsbTmcDevice(controller)
    device.failures, device.pending_clears = failures, 0
    light = ScpiLight(SETTINGS, "", UsbBus(device))
    try:
        light.connect()
    except DeviceError:
        assert device.n_open == 0
    else:
        _shine_once(light, controller, device)
    if not device.plugged_in:
        # A controller that is gone goes dark by the time that it was given.
        clock.sleep(5.001)
    _disconnect(light)
    assert not controller.lit
    return device


def _shine_once(light: ScpiLight, controller: Dc2200Double, device: UsbTmcDevice) -> None:
    try:
        light.on(0.5, 5.0)
    except DeviceError:
        assert not (controller.lit and device.plugged_in)
    with suppress(DeviceError):
        light.off()


def _disconnect(light: ScpiLight) -> None:
    with suppress(DeviceError):
        light.disconnect()


def supervised(*flags: str) -> SupervisedLight:
    return SupervisedLight([sys.executable, "-m", "tests.drivers.lights.supervised_scpi_light", *flags])


def test_it_works_under_a_supervisor_too() -> None:
    light = supervised()
    light.connect()
    assert light.describe().model == "DC2200"
    assert light.on(0.5, 3.0).level == pytest.approx(0.5)
    until(lambda: not light.read().lit)
    light.disconnect()


def test_what_it_says_of_its_protection_comes_through_the_supervisor() -> None:
    light = supervised("interlock_open")
    light.connect()
    with pytest.raises(UnsafeError, match=r"its interlock is open\. Close it"):
        light.on(0.5, 1.0)
    light.disconnect()


def test_it_tells_what_it_was_set_to_and_what_the_controller_allows() -> None:
    light = ScpiLight(SETTINGS, "", UsbBus(UsbTmcDevice(Dc2200Double())))
    light.connect()
    limit, terminal = light.describe().settings
    assert str(limit) == "the current limit 1 A (0 to 4)"
    assert (terminal.value, terminal.limits) == (1.0, Limits(1.0, 2.0, ""))
    light.disconnect()


def test_a_controller_that_does_not_tell_its_limits_is_good_all_the_same() -> None:
    controller = Dc2200Double()
    controller.knows_its_limits = False
    light = ScpiLight(ScpiLightSettings(max_current_a=1.0, answer_time_s=0.05), "", UsbBus(UsbTmcDevice(controller)))
    light.connect()
    assert [setting.limits for setting in light.describe().settings] == [None, None]
    assert light.on(0.5, 1.0).lit
    light.disconnect()


def test_its_settings_come_through_the_supervisor() -> None:
    light = supervised()
    light.connect()
    assert str(light.describe().settings[0]) == "the current limit 1 A (0 to 4)"
    light.disconnect()
