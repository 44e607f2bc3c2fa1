"""Which cameras there are, in words, and which one of them is meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.errors import DeviceError

GIGE_VISION = "GigEVision"


@dataclass(frozen=True, slots=True)
class ListedCamera:
    """A camera that answered, as Aravis lists it.

    Attributes
    ----------
    device_id : str
        Opens it.
    address : str
        In the network; of a camera at USB its id again.
    protocol : str
        ``"GigEVision"`` or ``"USB3Vision"``.
    """

    device_id: str
    make: str
    model: str
    serial_number: str
    address: str
    protocol: str

    @property
    def is_in_network(self) -> bool:
        """Whether it has an address in the network."""
        return self.protocol == GIGE_VISION

    @property
    def name(self) -> str:
        """Make, model and serial number."""
        return f"{self.make} {self.model} (serial number {self.serial_number})"

    def __str__(self) -> str:
        return f"{self.name} at {self.address if self.is_in_network else 'USB'}"


def choose(listed: Sequence[ListedCamera], address: str, serial_number: str | None, unusable: str) -> ListedCamera:
    """Return the one camera that is meant.

    Parameters
    ----------
    listed : sequence of ListedCamera
    address : str
        An address in the network, an id; ``""`` = any.
    serial_number : str, optional
        None = any.
    unusable : str
        What else is plugged in, and why it cannot be used; ``""`` for nothing.

    Raises
    ------
    DeviceError
        If none is there or more than one: what was looked for, what is there.
    """
    fitting = [
        camera
        for camera in listed
        if address in ("", camera.address, camera.device_id) and serial_number in (None, camera.serial_number)
    ]
    if len(fitting) == 1:
        return fitting[0]
    found = "; ".join(str(camera) for camera in listed) or "none"
    wanted = wanted_words(address, serial_number)
    if fitting:
        raise DeviceError(f"{len(fitting)} cameras are {wanted}: {found}. Set [camera] serial_number to one of them")
    raise DeviceError(f"no camera is {wanted}; found: {found}. {unusable or remedy(bool(listed))}")


def wanted_words(address: str, serial_number: str | None) -> str:
    """Return in words which camera is looked for."""
    by_serial = f"the GenICam camera with serial number {serial_number}" if serial_number else "a GenICam camera"
    return f"{by_serial} at {address}" if address else by_serial


def remedy(others: bool) -> str:
    """Return what to do where the camera that is meant is not."""
    if others:
        return "Correct [camera] serial_number or [camera.device] address, or plug that camera in"
    return (
        "Look at its power and cable; a camera in the network needs an address in the same subnet as this computer, "
        "and a firewall that lets UDP through"
    )
