"""What can go wrong between the computer and a device."""


class DeviceError(RuntimeError):
    """A device refused, failed, or did something that was not asked of it."""


class DeviceTimeoutError(DeviceError, TimeoutError):
    """A device did not answer within its time limit."""


class DeviceLostError(DeviceError, ConnectionError):
    """A device that was there is gone: unplugged, without power, or its port is closed."""


class UnsafeError(DeviceError):
    """Trying again would not help and might do harm: somebody has to look at the rig."""


class NotSafeError(DeviceError):
    """Something ended, and the light is not known to be off or the stage to stand: somebody has to look at the rig."""


class NotHomedError(DeviceError):
    """A stage whose position means nothing before it has found its zero: it has to be homed."""


class CancelledError(Exception):
    """A wait was called off by whoever runs the rig; no device failed."""


class DeviceLimitError(DeviceError, ValueError):
    """A setting or a position outside what the device allows."""


class DriverNotFoundError(DeviceError, LookupError):
    """No driver of that name, or its optional package is not installed."""
