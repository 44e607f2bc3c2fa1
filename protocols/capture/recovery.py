"""Retries a step of a capture after a device fault."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError, UnsafeError
from instrument.rig.bounded import Note
from instrument.rig.rig import Rig

ATTEMPTS = 3
"""How often a pose is begun before the capture gives up."""

RECONNECTS = 5
"""How often a device that is gone is looked for."""

BREATH = 1.0
"""Seconds on the rig's clock before a device is looked for again: a bus needs time to notice."""

Taken = TypeVar("Taken")


class Recovery:
    """What a run does about a device that fails.

    Parameters
    ----------
    rig : Rig
    note : callable
        The log.
    tell : callable
        Takes what happens, in words.
    """

    def __init__(self, rig: Rig, note: Note, tell: Callable[[str], None]) -> None:
        self._rig, self._note, self._tell = rig, note, tell
        # Only the very devices that the run began with may come back.
        self._serial_numbers: Mapping[str, str] = rig.serial_numbers

    def repeated(self, what: str, take: Callable[[int], Taken]) -> Taken:
        """Return what `take` takes; it is told the number of its attempt, from 1.

        Raises
        ------
        UnsafeError
            At once: repeating would not help.
        DeviceError
            What the last attempt met.
        """
        for attempt in range(1, ATTEMPTS):
            try:
                return take(attempt)
            except UnsafeError:
                raise
            except DeviceError as error:
                self._recover(what, attempt, error)
        return take(ATTEMPTS)

    def _recover(self, what: str, attempt: int, error: DeviceError) -> None:
        unsafe = self._rig.safe()
        self._note("repeated", what=what, attempt=attempt, why=str(error), unsafe=list(unsafe))
        self._tell(f"{what} failed and is repeated: {error}")
        if unsafe or isinstance(error, DeviceLostError | DeviceTimeoutError):
            self._reconnect()
        # Where an axis stands after a fault is never guessed.
        self._rig.stage.home()

    def _reconnect(self) -> None:
        for attempt in range(1, RECONNECTS + 1):
            self._rig.wait(BREATH)
            try:
                self._rig.reconnect(self._serial_numbers)
            except UnsafeError:
                raise
            except DeviceError as error:
                self._note("not reconnected", attempt=attempt, why=str(error))
                self._tell(f"a device does not come back ({attempt} of {RECONNECTS}): {error}")
                lost = error
            else:
                self._note("reconnected", attempt=attempt)
                return
        raise DeviceLostError(f"a device is gone and did not come back: {lost}")
