"""Which OAK cameras are attached, and the one that is meant; none is opened for that."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from drivers.driver import DeviceState, FoundDevice
from drivers.errors import DeviceError
from drivers.oak.sdk import depthai

_REMEDIES = {
    DeviceState.NO_PERMISSION: "copy drivers/udev/60-halfangle.rules to /etc/udev/rules.d, run udevadm control "
    "--reload and udevadm trigger, then plug the camera in again",
    DeviceState.BUSY: "close the program that uses it",
    DeviceState.UNKNOWN: "unplug it and plug it in again",
}
_NONE = (
    "Look at its cable (USB 3, plugged in at both ends), and at its power; a camera in the network has to be in this "
    "computer's. Where lsusb lists 03e7, install the rule drivers/udev/60-halfangle.rules"
)
# Of a device that waits to be opened; one that runs a program of its own (FLASH_BOOTED) can be opened all the same.
_READY = ("UNBOOTED", "BOOTLOADER", "FLASH_BOOTED", "BOOTED_NON_EXCLUSIVE", "GATE", "GATE_BOOTED", "GATE_SETUP")


def find_oak() -> Iterator[FoundDevice]:
    """Yield the cameras that are attached by USB or to the network, within a second.

    Raises
    ------
    DriverNotFoundError
        If depthai is not installed.
    """
    for info in listed(depthai()):
        state = state_of(info)
        name = f"Luxonis OAK {info.getDeviceId() or '(serial number unknown)'}"
        yield FoundDevice(name, _where(info), state, _REMEDIES.get(state, ""))


def listed(sdk: Any) -> Sequence[Any]:
    """Return a `depthai.DeviceInfo` for each camera, those included that may not be opened; takes half a second."""
    found: Sequence[Any] = sdk.XLinkConnection.getAllConnectedDevices(skipInvalidDevices=False)
    return found


def state_of(info: Any) -> DeviceState:
    """Return whether a `depthai.DeviceInfo` stands for a camera that can be opened."""
    status, state = _short(info.status), _short(info.state)
    if status == "INSUFFICIENT_PERMISSIONS":
        return DeviceState.NO_PERMISSION
    if status == "DEVICE_ALREADY_IN_USE" or state == "BOOTED":
        return DeviceState.BUSY
    return DeviceState.FOUND if status == "SUCCESS" and state in _READY else DeviceState.UNKNOWN


def chosen(infos: Iterable[Any], serial_number: str | None) -> Any:
    """Return the `depthai.DeviceInfo` of the camera that is meant.

    Parameters
    ----------
    serial_number : str, optional
        Of the one camera allowed; None = the only one.

    Raises
    ------
    DeviceError
        If it is not there, is not the only one, or may not be opened: what was looked for, what was found, what next.
    """
    present = list(infos)
    # A camera that may not be opened does not tell its serial number: it may be the one.
    meant = [info for info in present if serial_number in (None, info.getDeviceId()) or not info.getDeviceId()]
    named = f"with serial number {serial_number} " if serial_number else ""
    found = "; ".join(map(_described, present)) or "none"
    if not meant:
        raise DeviceError(f"no OAK camera {named}is there; found: {found}. {_NONE}.")
    usable = [info for info in meant if state_of(info) is DeviceState.FOUND]
    if len(usable) > 1:
        raise DeviceError(f"{len(usable)} OAK cameras are there: {found}. Set serial_number in [camera].")
    if not usable:
        remedies = dict.fromkeys(_REMEDIES[state_of(info)] for info in meant)
        raise DeviceError(f"the OAK camera {named}cannot be opened; found: {found}. Next: {'; '.join(remedies)}.")
    return usable[0]


def _described(info: Any) -> str:
    return f"{info.getDeviceId() or 'one without serial number'} at {_where(info)} ({state_of(info).value})"


def _where(info: Any) -> str:
    kind = "network" if _short(info.protocol).startswith("TCP_IP") else "USB"
    return f"{kind} {info.name}".rstrip()


def _short(member: Any) -> str:
    return str(member.name).removeprefix("X_LINK_")
