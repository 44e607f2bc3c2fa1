"""Aravis' own GigE Vision camera, on the loopback interface: a program that no one here wrote.

Its picture is a ramp of its own, whatever the exposure. There is room for one at a time on an interface, so runs of the
tests wait for one another.
"""

from __future__ import annotations

import os
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path
from types import TracebackType

import pytest
from filelock import FileLock

from drivers.errors import DriverNotFoundError
from drivers.genicam.aravis import library
from drivers.genicam.camera import GenicamCamera
from drivers.genicam.settings import GenicamSettings
from tests.drivers.double_clock import HANG

ADDRESS = "127.0.0.1"
SERIAL_NUMBER = f"T{os.getpid()}"
WIDTH, HEIGHT = 96, 64

_PROGRAM = "arv-fake-gv-camera-0.8"
_PORT = 3956
_LOCK = Path(tempfile.gettempdir()) / "halfangle-fake-genicam.lock"
_MAX_WAIT = 1500.0  # seconds, of which another run takes some minutes
_DISCOVERY = struct.pack(">BBHHH", 0x42, 0x11, 0x0002, 0, 1)
_CONTROL, _HEARTBEAT = 0x0A00, 0x0938


def skip_without_aravis() -> None:
    """Skip a test, with what to install, where there is no Aravis."""
    try:
        library()
    except DriverNotFoundError as error:
        pytest.skip(str(error))
    if shutil.which(_PROGRAM) is None:
        pytest.skip(f"the camera to test against is missing: apt install aravis-tools ({_PROGRAM})")


class FakeGenicam:
    """The program, while it is entered.

    Parameters
    ----------
    lost_per_thousand : int
        Packets of frames that it loses on purpose.
    light : Path, optional
        Record of the light that it sees (`tests.drivers.genicam.lit_genicam`); by default it shows a ramp of its own.
    description : Path, optional
        What it delivers instead of its own description; see `tests.drivers.genicam.modern_genicam`.
    """

    def __init__(self, lost_per_thousand: int = 0, light: Path | None = None, description: Path | None = None) -> None:
        skip_without_aravis()
        lit = [sys.executable, "-m", "tests.drivers.genicam.lit_genicam", SERIAL_NUMBER, str(light)]
        ramp = [_PROGRAM, "-i", ADDRESS, "-s", SERIAL_NUMBER, "-r", str(lost_per_thousand)]
        described = ["-g", str(description)] if description else []
        self._command = [*ramp, *described] if light is None else lit
        self._lock = FileLock(_LOCK, timeout=_MAX_WAIT)
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> FakeGenicam:
        self._lock.acquire()
        try:
            self.start()
        except BaseException:
            self._lock.release()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.kill()
        self._lock.release()

    def start(self) -> None:
        """Start it, and wait until it answers."""
        # It ends with the tests, however these end.
        die_with_parent = ["setpriv", "--pdeathsig", "KILL"] if shutil.which("setpriv") else []
        self._process = subprocess.Popen(
            [*die_with_parent, *self._command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + HANG
        while SERIAL_NUMBER.encode() not in _reply(_DISCOVERY):
            if time.monotonic() > deadline or self._process.poll() is not None:
                self.kill()
                raise RuntimeError(f"{_PROGRAM} does not answer at {ADDRESS}:{_PORT}. Has another program that port?")

    def kill(self) -> None:
        """End it without any leave-taking, as a pulled cable does."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()

    def camera(self, serial_number: str | None = None, width: int = WIDTH, height: int = HEIGHT, **settings: object):
        """Return a driver for it, not yet connected."""
        return GenicamCamera(GenicamSettings(address=ADDRESS, **settings), serial_number, width, height)


class SecondClient:
    """Another program that has control of the camera, as long as it keeps that up."""

    def __init__(self, heartbeat_ms: int = 3000) -> None:
        self._channel = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._channel.settimeout(HANG)
        self._channel.connect((ADDRESS, _PORT))
        self._write(_CONTROL, 2)
        self._write(_HEARTBEAT, heartbeat_ms)

    def close(self) -> None:
        """Die without a word, as a killed program does."""
        self._channel.close()

    def _write(self, register: int, value: int) -> None:
        self._channel.send(struct.pack(">BBHHHII", 0x42, 0x01, 0x0082, 8, 1, register, value))
        assert self._channel.recv(64)


def _reply(request: bytes) -> bytes:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as channel:
        channel.settimeout(0.05)
        channel.connect((ADDRESS, _PORT))
        try:
            channel.send(request)
            return channel.recv(512)
        except ConnectionRefusedError:
            time.sleep(0.01)
        except TimeoutError:
            pass
    return b""
