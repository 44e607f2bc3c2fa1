"""The conversation with a chain of Zaber devices, held by Zaber's own library.

Commands go out as they are and positions stay in the devices' units: so the library needs neither its database of
devices nor a network.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError, DriverNotFoundError
from drivers.serial_link.port import SerialPort
from drivers.zaber.flags import NONE

# A device answers within some milliseconds; a busy computer may take longer to hear it.
_ANSWER_LIMIT_MS = 2000
_MISSING = 'a Zaber stage needs zaber-motion. Install it: pip install "halfangle[zaber]"'


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a command.

    Attributes
    ----------
    data : str
    is_idle : bool
        Whether the axis (or every axis of the device) rests.
    flag : str
        The gravest warning flag; ``"--"`` if there is none.
    """

    data: str
    is_idle: bool
    flag: str


class _NotKnownError(DeviceError):
    """A command or a setting that a device does not have."""


class ZaberLink:
    """An open port with a chain of devices behind it.

    Parameters
    ----------
    port : str
        As the system calls it.
    baud_rate : int

    Raises
    ------
    DriverNotFoundError
        If zaber-motion or pyserial is not installed.
    DeviceError
        If the port cannot be opened: why, and how to mend it.
    """

    def __init__(self, port: str, baud_rate: int) -> None:
        self._port = port
        self._errors = _imported("zaber_motion")
        # Opened and closed again by pyserial first: it tells why a port cannot be opened, and who has it locked.
        SerialPort(port, baud_rate, 0.0).close()
        self._connection = self._opened(port, baud_rate)

    def ask(self, command: str, address: int, axis_number: int = 0) -> Reply:
        """Send a command to an axis, or with 0 to the whole device, and return the answer.

        Raises
        ------
        DeviceLostError
            If the port is gone.
        DeviceTimeoutError
            If no answer came, or none that was whole.
        DeviceError
            If the device refuses the command.
        """
        with self._explained(f"device {address} to {command!r}" if command else f"device {address}"):
            reply = self._connection.generic_command(command, address, axis_number, timeout=_ANSWER_LIMIT_MS)
        return Reply(str(reply.data), str(reply.status) == "IDLE", str(reply.warning_flag))

    def number(self, setting: str, address: int, axis_number: int) -> float:
        """Return a setting of an axis; NaN where the axis does not have it."""
        try:
            return float(self.ask(f"get {setting}", address, axis_number).data)
        except (_NotKnownError, ValueError):
            return float("nan")

    def flags(self, reply: Reply, address: int, axis_number: int) -> tuple[str, ...]:
        """Return every warning flag of an axis that answered with `reply`."""
        if reply.flag == NONE:
            return ()
        # The answer is their number, then the flags.
        return tuple(self.ask("warnings", address, axis_number).data.split()[1:])

    def addresses(self) -> tuple[int, ...]:
        """Return the addresses of the devices that answer, none if there is none."""
        with suppress(DeviceTimeoutError), self._explained():
            replies = self._connection.generic_command_multi_response("get deviceid", timeout=_ANSWER_LIMIT_MS)
            return tuple(int(reply.device_address) for reply in replies)
        return ()

    def close(self) -> None:
        """Give the port back; safe to call twice."""
        with suppress(DeviceError), self._explained():
            self._connection.close()

    def _opened(self, port: str, baud_rate: int) -> Any:
        try:
            # Direct: not by way of Zaber Launcher, which would let others move the stage meanwhile.
            return _imported("zaber_motion.ascii").Connection.open_serial_port(port, baud_rate, direct=True)
        except self._errors.MotionLibException as error:
            raise DeviceError(f"cannot open {port}. {error.message}") from None

    @contextmanager
    def _explained(self, whom: str = "the chain") -> Iterator[None]:
        """Turn the library's errors into ours."""
        errors: Any = self._errors
        gone = (errors.ConnectionClosedException, errors.ConnectionFailedException, errors.IoFailedException)
        try:
            yield
        except errors.RequestTimeoutException:
            # A request that is under way when the port goes ends so too.
            if not self._connection.is_open:
                raise self._lost("it was closed") from None
            raise DeviceTimeoutError(
                f"no answer from {whom} at {self._port} within {_ANSWER_LIMIT_MS / 1000.0:g} s. "
                "Look at its power, its cable and baud_rate"
            ) from None
        except gone as error:
            raise self._lost(error.message) from None
        except errors.BadCommandException as error:
            raise _NotKnownError(f"{self._port}: {error.message}") from None
        except errors.MotionLibException as error:
            raise DeviceError(f"{self._port}: {error.message}") from None

    def _lost(self, why: str) -> DeviceLostError:
        return DeviceLostError(f"{self._port} is gone ({why}). Look at the cable and the power, then connect again")


def _imported(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError:
        raise DriverNotFoundError(_MISSING) from None
