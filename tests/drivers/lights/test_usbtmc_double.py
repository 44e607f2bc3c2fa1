"""The double of a USBTMC device, as a client that was written elsewhere finds it."""

from collections.abc import Iterator
from importlib import import_module

import pytest
import pyvisa
import usb.backend.libusb1

from tests.drivers.lights.dc2200_double import Dc2200Double
from tests.drivers.lights.usbtmc_double import UsbBus, UsbTmcDevice

RESOURCE = "USB0::4883::32968::M00000001::0::INSTR"


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> UsbTmcDevice:
    device = UsbTmcDevice(Dc2200Double())
    bus = UsbBus(device)
    monkeypatch.setattr(usb.backend.libusb1, "get_backend", lambda: bus)
    return device


@pytest.fixture
def client(device: UsbTmcDevice) -> Iterator[pyvisa.resources.MessageBasedResource]:
    manager = pyvisa.ResourceManager("@py")
    with manager.open_resource(RESOURCE) as client:
        yield client
    manager.close()


def test_pyvisa_finds_it_on_the_bus(device: UsbTmcDevice) -> None:
    # Imported only now: at its import pyvisa-py looks whether there is a bus, and there may be no libusb.
    (found,) = import_module("pyvisa_py.protocols.usbtmc").find_tmc_devices(serial_number="M00000001")
    assert (found.idVendor, found.idProduct, found.product) == (0x1313, 0x80C8, "LED driver")


def test_pyvisa_asks_it_who_it_is(client: pyvisa.resources.MessageBasedResource) -> None:
    assert client.query("*IDN?").strip() == "Thorlabs,DC2200,M00000001,1.4.0"


def test_pyvisa_sets_it_and_reads_it_back(client: pyvisa.resources.MessageBasedResource) -> None:
    client.write("SOURCE1:PULSE:BRIGHTNESS 12.5")
    assert float(client.query("SOUR1:PULS:BRIG:LEV:AMPL?")) == pytest.approx(12.5)


def test_pyvisa_reads_an_answer_in_pieces(client: pyvisa.resources.MessageBasedResource) -> None:
    client.write("*IDN?")
    assert client.read_bytes(32, chunk_size=8) == b"Thorlabs,DC2200,M00000001,1.4.0\n"


def test_pyvisa_runs_out_of_time_when_it_does_not_answer(client: pyvisa.resources.MessageBasedResource) -> None:
    client.write("OUTPUT1:STATE OFF")
    with pytest.raises(pyvisa.errors.VisaIOError, match=r"Timeout expired"):
        client.read()
