"""SCPI: commands, questions, and settings that are read back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.limits import Limits
from drivers.readback import Setting

_NO_ERROR = 0
# A queue of errors that is longer than this does not end.
_LONGEST_ERROR_QUEUE = 32


class Transport(Protocol):
    """Whole messages to and from one device."""

    def write(self, message: bytes) -> None:
        """Send a message."""

    def query(self, message: bytes) -> bytes:
        """Send a message and return the answer."""


@dataclass(frozen=True, slots=True)
class ScpiSetting:
    """A number that a device holds.

    Attributes
    ----------
    name : str
        For messages.
    header : str
        SCPI header; with a question mark it asks for the value.
    unit : str
    tolerance : float
        Largest difference between what was set and what is read back, in `unit`.
    """

    name: str
    header: str
    unit: str
    tolerance: float

    def agree(self, held: float, value: float) -> bool:
        """Tell whether a value that is read back is the one that was set."""
        return math.isclose(held, value, rel_tol=0.0, abs_tol=self.tolerance)


class ScpiDialogue:
    """Speaks SCPI over any transport of whole messages.

    Parameters
    ----------
    transport : Transport
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def command(self, text: str) -> None:
        """Send a command that has no answer."""
        self._transport.write(f"{text}\n".encode("ascii"))

    def ask(self, question: str) -> str:
        """Return the answer to a question, without its line end."""
        answer = self._transport.query(f"{question}\n".encode("ascii"))
        return answer.decode("ascii", errors="replace").strip()

    def number(self, question: str) -> float:
        """Return the answer to a question, which has to be a number.

        Raises
        ------
        DeviceError
            With what it was instead.
        """
        answer = self.ask(question)
        try:
            return float(answer)
        except ValueError:
            raise DeviceError(f"the answer to {question!r} is {answer!r}; expected was a number") from None

    def flag(self, question: str) -> bool:
        """Return the answer to a question, which has to be 0 or 1."""
        return self.number(question) != 0.0

    def set_verified(self, setting: ScpiSetting, value: float) -> float:
        """Set a number and return what the device reads back.

        Raises
        ------
        DeviceError
            If the device refuses it, or holds another value than it was told.
        """
        self.command(f"{setting.header} {value:.9g}")
        self.check_errors(f"{setting.name} = {value:g} {setting.unit}")
        held = self.number(f"{setting.header}?")
        if not setting.agree(held, value):
            raise DeviceError(
                f"{setting.name} was set to {value:g} {setting.unit} and is read back as {held:g} {setting.unit}; "
                f"allowed is a difference of {setting.tolerance:g} {setting.unit}. "
                "Look at the limits on the device's own panel"
            )
        return held

    def ensure(self, setting: ScpiSetting, value: float) -> None:
        """Set a number as `set_verified` does, unless the device holds it already.

        For what a device may keep in a memory that wears out.
        """
        if not setting.agree(self.number(f"{setting.header}?"), value):
            self.set_verified(setting, value)

    def read_back(self, setting: ScpiSetting) -> Setting:
        """Return what the device holds and what it allows; without limits where it does not know the question."""
        held = self.number(f"{setting.header}?")
        try:
            limits = Limits(self.number(f"{setting.header}? MIN"), self.number(f"{setting.header}? MAX"), setting.unit)
        except DeviceTimeoutError:
            # It has put an error into its queue instead of an answer.
            self.command("*CLS")
            limits = None
        return Setting(setting.name, held, setting.unit, limits)

    def check_errors(self, after: str) -> None:
        """Empty the device's queue of errors.

        Raises
        ------
        DeviceError
            Names every error that was in it.
        """
        errors = self._errors()
        if errors:
            raise DeviceError(f"the device refuses {after}: {'; '.join(errors)}")

    def _errors(self) -> list[str]:
        errors: list[str] = []
        while len(errors) < _LONGEST_ERROR_QUEUE:
            answer = self.ask("SYST:ERR?")
            number, _, text = answer.partition(",")
            if not number.strip().lstrip("+-").isdigit():
                return [*errors, f"the answer to 'SYST:ERR?' is {answer!r}"]
            if int(number) == _NO_ERROR:
                return errors
            description = text.strip().strip('"')
            errors.append(f"error {int(number)}, {description}")
        return errors
