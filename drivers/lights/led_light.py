"""A LED light that is told its level and answers for it: connecting dark, shining under a lease, leaving dark."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from contextlib import suppress

from drivers.errors import DeviceError, DeviceLostError, UnsafeError
from drivers.lease import check_lease, check_level
from drivers.light import LightDescription, LightState

MAY_SHINE = "It does not answer and may still shine: switch it off by hand"

_MARGIN = 1.0  # seconds that a lease of the device's own may end later than its number says

DARK = LightState(lit=False, level=0.0, monitor=math.nan, temperature=math.nan)


class LedLight(ABC):
    """What every driver of a LED light does alike; a driver adds how its device is talked to.

    Parameters
    ----------
    longest_lease : float
        Longest time that it may shine without being told again, seconds.
    """

    _ends_by_itself = False
    """Whether the device ends its lease without being told, whatever becomes of the computer and the cable."""

    def __init__(self, longest_lease: float) -> None:
        self._longest_lease = longest_lease
        self._may_shine_until = -math.inf
        self._description: LightDescription | None = None

    def connect(self) -> None:
        """Open the device, dark; safe to call twice.

        Raises
        ------
        DeviceError
            If it is not there, not allowed, busy or another device; then nothing stays open.
        """
        if self._description is not None and self._is_open:
            return
        try:
            self._open()
            self._description = self._identified()
            if self.off().lit:
                raise UnsafeError(f"the light {self._name} does not go off. Switch it off by hand")
            self._description = self._prepared(self._description)
        except BaseException:
            self._forget()
            raise

    def disconnect(self) -> None:
        """Switch off and close; safe to call twice, and without `connect`."""
        try:
            self.off()
        finally:
            self._forget()

    def describe(self) -> LightDescription:
        """Return what the device says that it is."""
        if self._description is None:
            raise DeviceError("the light is not connected. Call connect() first.")
        return self._description

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine at `level` for at most `max_seconds`, then go dark unless told again.

        Raises
        ------
        DeviceLimitError
            If `level` is outside the limits, or `max_seconds` not positive, or longer than the settings allow.
        UnsafeError
            If the device protects itself or its user: names why.
        """
        self.describe()
        check_level(level)
        check_lease(max_seconds, self._longest_lease)
        try:
            return self._shine(level, max_seconds)
        except BaseException:
            # What went wrong first is the message; the lease ends the light if this fails too.
            with suppress(DeviceError):
                self._switch_off()
            raise

    def off(self) -> LightState:
        """Go dark and confirm it by read-back; safe to call at any time.

        Raises
        ------
        DeviceLostError
            If the device is gone and was not dark when it was last heard. Gone is not dark.
        """
        if self._description is None:
            return self._dark_if_known(None)
        try:
            self._switch_off()
            state = self._state()
        except DeviceLostError as error:
            return self._dark_if_known(error)
        if not state.lit:
            self._may_shine_until = -math.inf
        return state

    def _will_shine(self, max_seconds: float) -> None:
        """Note that it may shine from now on: called before the command, which may be obeyed and not answered."""
        self._may_shine_until = time.monotonic() + max_seconds + _MARGIN if self._ends_by_itself else math.inf

    def _dark_if_known(self, error: DeviceLostError | None) -> LightState:
        """Return that it is dark, where it was so when it was last heard and nobody has told it to shine since."""
        if time.monotonic() < self._may_shine_until:
            raise DeviceLostError(f"{error or 'the light is gone'}. {MAY_SHINE}") from error
        return DARK

    def read(self) -> LightState:
        """Return the state as the device reports it."""
        self.describe()
        return self._state()

    def _forget(self) -> None:
        self._description = None
        self._close()

    @property
    @abstractmethod
    def _is_open(self) -> bool:
        """Whether the device can be talked to."""

    @property
    @abstractmethod
    def _name(self) -> str:
        """What a message calls the device."""

    @abstractmethod
    def _open(self) -> None:
        """Open the device; what fails half way, `_close` takes back."""

    @abstractmethod
    def _close(self) -> None:
        """Close the device; safe to call at any time."""

    @abstractmethod
    def _identified(self) -> LightDescription:
        """Return what the device says that it is, or raise `DeviceError` if it is another one."""

    def _prepared(self, description: LightDescription) -> LightDescription:
        """Set what holds for the whole connection, the light being off; return the description with it."""
        return description

    @abstractmethod
    def _shine(self, level: float, max_seconds: float) -> LightState:
        """Shine, and return the state that the device reports; call `_will_shine` before the command that lights it."""

    @abstractmethod
    def _switch_off(self) -> None:
        """Tell the device to go dark."""

    @abstractmethod
    def _state(self) -> LightState:
        """Return the state that the device reports."""
