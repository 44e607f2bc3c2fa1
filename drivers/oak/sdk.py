"""The SDK, imported when it is needed and told to keep to itself."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from drivers.errors import DeviceError, DeviceLostError, DriverNotFoundError

# An instrument tells nobody what it does, and its output is its own: read by the SDK when it is imported. Whoever
# has set one of these has decided for themselves.
_QUIET = {
    "DEPTHAI_TELEMETRY": "0",
    "DEPTHAI_DISABLE_FEEDBACK": "1",
    "DEPTHAI_DISABLE_STARTUP_NOTIFICATIONS": "1",
    "DEPTHAI_LEVEL": "error",
}


def depthai() -> Any:
    """Return the SDK.

    Raises
    ------
    DriverNotFoundError
        If it is not installed, or is older than its version 3.
    """
    for name, value in _QUIET.items():
        os.environ.setdefault(name, value)
    try:
        sdk: Any = import_module("depthai")
    except ImportError:
        raise DriverNotFoundError('a Luxonis OAK needs depthai. Install it: pip install "halfangle[oak]"') from None
    if int(sdk.__version__.split(".")[0]) < 3:
        raise DriverNotFoundError(f'depthai is {sdk.__version__}; 3 is needed: pip install --upgrade "halfangle[oak]"')
    return sdk


@contextmanager
def sdk_errors_explained(sdk: Any) -> Iterator[None]:
    """Turn the SDK's errors into ours."""
    try:
        yield
    except (sdk.XLinkError, sdk.MessageQueue.QueueException) as error:
        raise DeviceLostError(
            f"the OAK camera is gone ({error}). Look at its cable and its power, then connect again"
        ) from None
    # The SDK has no error of its own for the rest.
    except RuntimeError as error:
        if isinstance(error, DeviceError):
            raise
        raise DeviceError(f"the OAK camera failed: {error}. Unplug it, plug it in, and connect again") from error
