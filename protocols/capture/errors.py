"""Errors that stop a capture before its end."""

from __future__ import annotations

from drivers.errors import DeviceError, NotSafeError


class CaptureFaultError(DeviceError):
    """A capture stopped because of a device; its session can be resumed."""


class NotSafeCaptureError(CaptureFaultError, NotSafeError):
    """A capture stopped, and its rig is not known to be dark and still; its session can be resumed."""


class PausedError(Exception):
    """The run is to stop between two poses; the message says why."""
