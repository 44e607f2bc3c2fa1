"""Whether a window can be shown: asked before Qt, which ends the process by a signal where none can."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Mapping
from pathlib import Path

_NEXT = "Start the console at a desktop, or use halfangle capture, which needs no window"

_XCB_LIBRARIES = ("libxcb.so.1", "libxcb-cursor.so.0")  # of those that Qt loads late, the two that are often missing


def display_problem(environment: Mapping[str, str] = os.environ) -> str | None:
    """Say why no window can be shown on this computer; None where one can, or where only Qt knows.

    Parameters
    ----------
    environment : mapping of str to str
    """
    if sys.platform != "linux" or environment.get("QT_QPA_PLATFORM", "xcb").partition(":")[0] != "xcb":
        return None
    display, wayland = environment.get("DISPLAY"), environment.get("WAYLAND_DISPLAY")
    if wayland and _wayland_socket(wayland, environment).is_socket():
        return None
    if display:
        return _x_problem(display)
    if wayland:
        return f"nothing answers at WAYLAND_DISPLAY={wayland}: that desktop has gone. {_NEXT}"
    return f"there is no display for the window (neither DISPLAY nor WAYLAND_DISPLAY is set). {_NEXT}"


def _wayland_socket(name: str, environment: Mapping[str, str]) -> Path:
    return Path(environment.get("XDG_RUNTIME_DIR", "")) / name


def _x_problem(display: str) -> str | None:
    missing = [name for name in _XCB_LIBRARIES if not _loads(name)]
    if missing:
        return f"the window needs {' and '.join(missing)} of the system, which `make setup` brings"
    xcb = ctypes.CDLL(_XCB_LIBRARIES[0])
    xcb.xcb_connect.restype = ctypes.c_void_p
    connection = ctypes.c_void_p(xcb.xcb_connect(display.encode(), None))
    try:
        failed = xcb.xcb_connection_has_error(connection)
    finally:
        xcb.xcb_disconnect(connection)
    if not failed:
        return None
    return f"nothing answers at DISPLAY={display}, or it refuses this user: a desktop that has gone? {_NEXT}"


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
