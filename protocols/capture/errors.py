"""Errors that stop a capture before its end."""

from __future__ import annotations

from drivers.errors import DeviceError


class CaptureFaultError(DeviceError):
    """A capture stopped because of a device; its session can be resumed."""


class PausedError(Exception):
    """The run is to stop between two poses; the message says why."""
