"""What can go wrong between the computer and a device."""


class DeviceError(RuntimeError):
    """A device refused, failed, or did something that was not asked of it."""


class DeviceTimeoutError(DeviceError, TimeoutError):
    """A device did not answer within its time limit."""


class DeviceLimitError(DeviceError, ValueError):
    """A setting or a position outside what the device allows."""


class DriverNotFoundError(DeviceError, LookupError):
    """No driver of that name, or its optional package is not installed."""
