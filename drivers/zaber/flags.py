"""What the warning flags of a Zaber device mean and what to do next.

After the list of the ASCII protocol's manual. N flags and the rest of the W flags are notes: they hinder nothing,
and an axis that is not where it should be is found by its position.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from drivers.errors import DeviceError, UnsafeError

NONE = "--"


@dataclass(frozen=True, slots=True)
class Flag:
    """A warning flag.

    Attributes
    ----------
    what, next_ : str
        What has happened, and what to do.
    is_unsafe : bool
        Trying again would not help: somebody has to look at the stage.
    """

    what: str
    next_: str
    is_unsafe: bool = False


_HOME = "Home the stage"
_LOOK = "Look at the stage, its load and its power; switch the device off and on, then home the stage"
_FREE = "Look what is in the way of the axis, then home the stage"
_ENABLE = "Find out why; enable the driver in Zaber Launcher (driver enable), then home the stage"

BLOCKING = {
    "FF": Flag("critical system error", "Switch the device off and on; if it stays, ask Zaber", True),
    "FN": Flag("the peripheral is not supported", "Correct the peripheral's id in Zaber Launcher"),
    "FZ": Flag("the peripheral is not active", "Activate it in Zaber Launcher, then home the stage"),
    "FH": Flag("the emergency stop was pressed", "Look at the stage; release the button, enable the driver", True),
    "FV": Flag("the supply's voltage is too high or too low", _LOOK, True),
    "FO": Flag("its driver was disabled, at its start or by a command", _ENABLE),
    "FC": Flag("the current rose too fast", _LOOK, True),
    "FM": Flag("the motor is too hot", "Let it cool; look at its load and its way, then home the stage", True),
    "FD": Flag("its driver is disabled", _ENABLE),
    "FQ": Flag("the encoder fails", _LOOK, True),
    "FI": Flag("the encoder's index fails", _LOOK, True),
    "FA": Flag("the analog encoder is out of step", _LOOK, True),
    "FR": Flag("it was overdriven for too long", _LOOK, True),
    "FS": Flag("it stalled and stopped", _FREE),
    "FB": Flag("a stream left its bounds", _HOME),
    "FP": Flag("the path deviates too far", _HOME),
    "FE": Flag("it met a limit sensor where none should be", _FREE),
    "FT": Flag("it is twisted too far", "Look at the cables of the axis, then turn it back by hand", True),
    "WL": Flag("a limit sensor was triggered unexpectedly", _FREE),
    "WR": Flag("it has no reference position", _HOME),
    "WH": Flag("it was not homed", _HOME),
}
_UNKNOWN_FAULT = Flag("a fault that this driver does not know", "See the ASCII protocol's manual")
NOTES = {
    "WV": "voltage out of range",
    "WT": "controller hot",
    "WS": "stalled and recovered",
    "WM": "displaced when it stood still",
    "WP": "calibration of a wrong type",
    "NC": "moved by hand with its knob",
    "NI": "movement interrupted",
    "ND": "stream interrupted",
    "NR": "value rounded",
    "NT": "value truncated",
    "NU": "setting waits to be applied",
    "NJ": "joystick is calibrating",
    "NB": "firmware is being updated",
}


def is_blocking(flag: str) -> bool:
    """Return whether an axis with this flag must not be moved, or not be trusted."""
    return flag in BLOCKING or flag.startswith("F")


def blocked(name: str, flags: Iterable[str]) -> DeviceError | None:
    """Return the error for an axis with these flags; None if none of them hinders it."""
    meanings = {flag: BLOCKING.get(flag, _UNKNOWN_FAULT) for flag in flags if is_blocking(flag)}
    if not meanings:
        return None
    # What is unsafe has the last word on what to do.
    worst = max(meanings.values(), key=lambda meaning: meaning.is_unsafe)
    kind = UnsafeError if worst.is_unsafe else DeviceError
    found = ", ".join(f"{flag}: {meaning.what}" for flag, meaning in meanings.items())
    return kind(f"axis {name} reports {found}. {worst.next_}.")


def noted(flags: Iterable[str]) -> str:
    """Return the flags with their names, for a message."""
    return ", ".join(f"{flag}: {NOTES.get(flag, 'unknown')}" for flag in flags)
