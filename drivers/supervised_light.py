"""A light in a process of its own, so that it goes off when this one dies.

For a light that has no time limit itself: `drivers.light_supervisor` owns its port.
"""

from __future__ import annotations

import json
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
from drivers.lights.led_light import DARK, MAY_SHINE

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
        self._is_connected = self._may_shine = False

    def connect(self) -> None:
        """Start the supervisor and open the device, dark; safe to call twice."""
        if self._process is None:
            # A session of its own: what a terminal sends to its programs does not reach it.
            pipe = subprocess.PIPE
            self._process = subprocess.Popen(self._command, stdin=pipe, stdout=pipe, start_new_session=True)
            self._rest = b""
            self._is_connected = False
        try:
            self._ask("connect", limit=_CONNECT_LIMIT)
            # A light is dark when its driver has connected it.
            self._is_connected, self._may_shine = True, False
        except DeviceError:
            # What went wrong first is the message; `off` tells what is known of the light then.
            with suppress(DeviceError):
                self.disconnect()
            raise

    def disconnect(self) -> None:
        """Let the supervisor switch off, close and end; safe to call twice, and without `connect`.

        Raises
        ------
        DeviceLostError
            If it cannot tell that the light is off.
        """
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
            raise DeviceTimeoutError(f"the light's supervisor does not end. {MAY_SHINE}") from None
        self._heed_end_of(process)
        self._refuse_if_unknown()

    def describe(self) -> LightDescription:
        """Return what the connected light is."""
        return _DESCRIPTION.validate_python(self._ask("describe"))

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine at `level` for at most `max_seconds`, then go dark unless told again."""
        process = self._tell("on", level, max_seconds)
        # It may be obeyed and not answered.
        self._may_shine = True
        return LightState(**self._hear(process, "on", _ANSWER_LIMIT))

    def off(self) -> LightState:
        """Go dark and confirm it; safe to call at any time.

        Raises
        ------
        DeviceLostError
            If the light or its supervisor is gone, and it was not dark when it was last heard. Gone is not dark.
        """
        if self._process is None:
            self._refuse_if_unknown()
            return DARK
        try:
            state = LightState(**self._ask("off"))
        except DeviceLostError:
            if self._may_shine:
                raise
            return DARK
        self._may_shine = state.lit
        return state

    def read(self) -> LightState:
        """Return the state as the device reports it."""
        return LightState(**self._ask("read"))

    def _heed_end_of(self, process: subprocess.Popen[bytes]) -> None:
        # One that never reached the light knows nothing of it.
        if self._is_connected and process.returncode == 0:
            self._may_shine = False

    def _refuse_if_unknown(self) -> None:
        if self._may_shine:
            raise DeviceLostError(f"the light is gone. {MAY_SHINE}")

    def _ask(self, act: str, *arguments: float, limit: float = _ANSWER_LIMIT) -> Any:
        return self._hear(self._tell(act, *arguments), act, limit)

    def _tell(self, act: str, *arguments: float) -> subprocess.Popen[bytes]:
        process = self._process
        if process is None or process.stdin is None:
            raise DeviceError("the light is not connected. Call connect() first.")
        try:
            process.stdin.write(json.dumps({"act": act, "arguments": arguments}).encode() + b"\n")
            process.stdin.flush()
        except OSError:
            raise DeviceLostError(self._left(process)) from None
        return process

    def _hear(self, process: subprocess.Popen[bytes], act: str, limit: float) -> Any:
        reply = json.loads(self._line(process, act, limit))
        if "error" in reply:
            raise getattr(errors, reply["error"])(reply["message"])
        return reply["value"]

    def _line(self, process: subprocess.Popen[bytes], act: str, limit: float) -> bytes:
        assert process.stdout is not None
        replies = process.stdout.fileno()
        deadline = time.monotonic() + limit
        while b"\n" not in self._rest:
            ready, _, _ = select.select([replies], [], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                raise DeviceTimeoutError(f"the light did not answer {act!r} within {limit:g} s")
            received = os.read(replies, 65536)
            if not received:
                raise DeviceLostError(self._left(process))
            self._rest += received
        line, self._rest = self._rest.split(b"\n", 1)
        return line

    def _left(self, process: subprocess.Popen[bytes]) -> str:
        """Say how the supervisor left the light, when it is gone."""
        with suppress(subprocess.TimeoutExpired):
            process.wait(_ANSWER_LIMIT)
        self._heed_end_of(process)
        known = f"The light: {MAY_SHINE}" if self._may_shine else "The light is off"
        return f"the light's supervisor ended. {known}. Connect it again"
