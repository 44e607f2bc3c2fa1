"""Reads a file in a child process, since a damaged one can crash or stop its reader."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import Any

SILENCE_SECONDS = 120.0
"""No disk takes so long for one step; what only computes is stopped much earlier (`STEP_SECONDS`)."""

STEP_SECONDS = 10.0
"""Computing time of one step, for one frame or dataset; the largest frame takes half of it."""

_ENDINGS = {signal.SIGPROF: "did not come to an end", signal.SIGKILL: "was stopped"}


class ReaderEndedError(RuntimeError):
    """The child ended in the middle of its work; the message says how."""


def in_child(task: str, *arguments: str | int | Path) -> Iterator[dict[str, Any]]:
    """Yield what a task of `child_main` says, step by step.

    Parameters
    ----------
    task : str
        A key of `child_main.TASKS`.
    *arguments : str, int or Path

    Raises
    ------
    ReaderEndedError
        If the child was ended by the file, or says nothing for `SILENCE_SECONDS`.
    """
    # -P: a folder of strange files may hold a numpy.py, which must not be found there.
    command = [
        sys.executable,
        "-P",
        "-m",
        "instrument.session_tools.child_main",
        str(STEP_SECONDS),
        task,
        *map(str, arguments),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=_environment()) as child:
        try:
            yield from _lines(child)
        finally:
            child.kill()
    if child.returncode:
        raise ReaderEndedError(_ending(child.returncode))


def _environment() -> dict[str, str]:
    """Return an environment in which the child imports the very files that this process did.

    It gets one thread: those of the numerical libraries would take up the address space that it may have.
    """
    paths = [str(Path(__file__).resolve().parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}


def _lines(child: subprocess.Popen[bytes]) -> Iterator[dict[str, Any]]:
    said: Queue[bytes] = Queue()
    Thread(target=_listen, args=(child, said), daemon=True).start()
    while True:
        try:
            line = said.get(timeout=SILENCE_SECONDS)
        except Empty:
            return
        if not line.endswith(b"\n"):
            child.wait()
            return
        yield json.loads(line)


def _listen(child: subprocess.Popen[bytes], said: Queue[bytes]) -> None:
    assert child.stdout is not None
    # Whoever wants no more closes it, which the reader notices in the middle of a line.
    with suppress(ValueError):
        for line in child.stdout:
            said.put(line)
    said.put(b"")


def _ending(code: int) -> str:
    if code > 0:
        return f"failed (exit code {code})"
    return _ENDINGS.get(signal.Signals(-code), f"crashed ({signal.Signals(-code).name})")
