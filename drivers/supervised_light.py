"""A light in a process of its own, so that it goes off when this one dies.

For a light that has no time limit itself: `drivers.light_supervisor` owns its port.
"""

from __future__ import annotations

import json
import math
import os
import select
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from pydantic import TypeAdapter

from drivers import errors
from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError
from drivers.light import LightDescription, LightState

# Seconds for an answer; opening a port may take longer.
_ANSWER_LIMIT, _CONNECT_LIMIT = 4.0, 50.0
_DESCRIPTION = TypeAdapter(LightDescription)


def supervisor_command(rig: Mapping[str, Any]) -> list[str]:
    """Return the command of the process that owns the light of a parsed rig.toml."""
    return [sys.executable, "-m", "drivers.light_supervisor", json.dumps(rig)]


class SupervisedLight:
    """Speaks to the light by way of its supervisor.

    Parameters
    ----------
    command : sequence of str
        Starts the supervisor; see `supervisor_command`.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._command = list(command)
        self._process: subprocess.Popen[bytes] | None = None
        self._rest = b""

    def connect(self) -> None:
        """Start the supervisor and open the device, dark; safe to call twice."""
        if self._process is None:
            # A session of its own: what a terminal sends to its programs does not reach it.
            pipe = subprocess.PIPE
            self._process = subprocess.Popen(self._command, stdin=pipe, stdout=pipe, start_new_session=True)
            self._rest = b""
        try:
            self._ask("connect", limit=_CONNECT_LIMIT)
        except DeviceError:
            self.disconnect()
            raise

    def disconnect(self) -> None:
        """Let the supervisor switch off, close and end; safe to call twice, and without `connect`."""
        process, self._process = self._process, None
        if process is None:
            return
        for stream in (process.stdin, process.stdout):
            # What was not read any more by a supervisor that is gone cannot be sent.
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        try:
            process.wait(_ANSWER_LIMIT)
        except subprocess.TimeoutExpired:
            raise DeviceTimeoutError("the light's supervisor does not end; is the light off? Look at it") from None

    def describe(self) -> LightDescription:
        """Return what the connected light is."""
        return _DESCRIPTION.validate_python(self._ask("describe"))

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine at `level` for at most `max_seconds`, then go dark unless told again."""
        return LightState(**self._ask("on", level, max_seconds))

    def off(self) -> LightState:
        """Go dark and confirm it; safe to call at any time."""
        if self._process is None:
            # Without a supervisor nobody has switched it on, or the last one has switched it off.
            return LightState(lit=False, level=0.0, monitor=math.nan, temperature=math.nan)
        return LightState(**self._ask("off"))

    def read(self) -> LightState:
        """Return the state as the device reports it."""
        return LightState(**self._ask("read"))

    def _ask(self, act: str, *arguments: float, limit: float = _ANSWER_LIMIT) -> Any:
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            raise DeviceError("the light is not connected. Call connect() first.")
        try:
            process.stdin.write(json.dumps({"act": act, "arguments": arguments}).encode() + b"\n")
            process.stdin.flush()
            reply = json.loads(self._line(process.stdout.fileno(), act, limit))
        except OSError as error:
            if isinstance(error, DeviceError):
                raise
            raise DeviceLostError(f"the light's supervisor is gone, and with it the light: {error}") from None
        if "error" in reply:
            raise getattr(errors, reply["error"])(reply["message"])
        return reply["value"]

    def _line(self, replies: int, act: str, limit: float) -> bytes:
        deadline = time.monotonic() + limit
        while b"\n" not in self._rest:
            ready, _, _ = select.select([replies], [], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                raise DeviceTimeoutError(f"the light did not answer {act!r} within {limit:g} s")
            received = os.read(replies, 65536)
            if not received:
                raise DeviceLostError("the light's supervisor ended; it switched the light off. Connect it again")
            self._rest += received
        line, self._rest = self._rest.split(b"\n", 1)
        return line
