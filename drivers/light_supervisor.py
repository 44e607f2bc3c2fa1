"""The process that owns a light's port: it switches the light off when its lease ends or its parent dies.

It reads requests from its standard input, a JSON object a line, and answers each with one on its standard output. When
the input ends, which it does however the parent ends, kill -9 included, the light goes off.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from drivers.errors import DeviceError, DeviceLostError
from drivers.light import Light
from drivers.registry import open_lone_light

# Seconds from one try to switch off to the next, and after which there is nothing left but to end.
_RETRY, _LONGEST_DARKENING = 0.2, 60.0


NOT_KNOWN_DARK = 3
"""Exit code of the process where the light is gone, or does not go off."""


def supervise(light: Light, requests: int, replies: int) -> int:
    """Serve one light until the input ends; leave it dark.

    Parameters
    ----------
    light : Light
        Not yet connected.
    requests, replies : int
        File descriptors.

    Returns
    -------
    int
        Exit code of the process: 0 if the light is known to be dark, else `NOT_KNOWN_DARK`.
    """
    # A Ctrl-C goes to every process of a terminal; whether the light goes off is the parent's to say.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    supervisor = _Supervisor(light)
    try:
        supervisor.serve(requests, replies)
    finally:
        is_dark = supervisor.darken()
        # Nobody is left to hear that it failed, and all that can be done was done.
        with suppress(DeviceError):
            light.disconnect()
    return 0 if is_dark else NOT_KNOWN_DARK


class _Supervisor:
    def __init__(self, light: Light) -> None:
        self._light = light
        self._lease_end: float | None = None
        self._acts: dict[str, Callable[..., Any]] = {
            "connect": light.connect,
            "disconnect": light.disconnect,
            "describe": light.describe,
            "on": self._on,
            "off": self._off,
            "read": light.read,
        }

    def serve(self, requests: int, replies: int) -> None:
        rest = b""
        while True:
            ready, _, _ = select.select([requests], [], [], self._seconds_left())
            if not ready:
                self.darken()
                continue
            received = os.read(requests, 65536)
            if not received:
                return
            *lines, rest = (rest + received).split(b"\n")
            for line in lines:
                os.write(replies, json.dumps(self._answer(json.loads(line))).encode() + b"\n")

    def darken(self) -> bool:
        """Switch off until the light confirms it, or for as long as makes sense; return whether it did."""
        self._lease_end = None
        end = time.monotonic() + _LONGEST_DARKENING
        while time.monotonic() < end:
            try:
                if not self._light.off().lit:
                    return True
            except DeviceLostError:
                # What is gone hears nothing more; its driver leaves it dark when it is connected again.
                return False
            except DeviceError:
                pass
            time.sleep(_RETRY)
        return False

    def _seconds_left(self) -> float | None:
        return None if self._lease_end is None else max(0.0, self._lease_end - time.monotonic())

    def _answer(self, request: dict[str, Any]) -> dict[str, Any]:
        try:
            value = self._acts[request["act"]](*request.get("arguments", ()))
        except DeviceError as error:
            return {"error": _known_name(error), "message": str(error)}
        # A driver of somebody else may fail in any way; this process has to outlive it, to switch off.
        except Exception as error:
            return {"error": DeviceError.__name__, "message": f"the light's driver failed: {error!r}"}
        return {"value": None if value is None else asdict(value)}

    def _on(self, level: float, max_seconds: float) -> Any:
        # A command that failed may have been obeyed: the lease is over unless it is known to have begun.
        self._lease_end = time.monotonic()
        state = self._light.on(level, max_seconds)
        self._lease_end = time.monotonic() + max_seconds
        return state

    def _off(self) -> Any:
        state = self._light.off()
        if not state.lit:
            self._lease_end = None
        return state


def _known_name(error: DeviceError) -> str:
    """Return the class of an error that the other process knows too."""
    return next(kind.__name__ for kind in type(error).__mro__ if kind.__module__ == DeviceError.__module__)


if __name__ == "__main__":
    sys.exit(supervise(open_lone_light(json.loads(sys.argv[1])), sys.stdin.fileno(), sys.stdout.fileno()))
