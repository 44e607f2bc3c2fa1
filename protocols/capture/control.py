"""How somebody asks a running capture to stop: at the next pose, or at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event
from types import FrameType

from drivers.errors import CancelledError


class Control:
    """Requests to a capture, from any thread.

    Attributes
    ----------
    cancel : threading.Event
        Set by `abort`; ends every wait on the rig.
    """

    def __init__(self) -> None:
        self.cancel = Event()
        self._pause = Event()

    def pause(self) -> None:
        """Ask to stop after the pose that is being taken."""
        self._pause.set()

    def abort(self) -> None:
        """Ask to stop now; the pose that is being taken is lost."""
        self.cancel.set()

    @property
    def pause_asked(self) -> bool:
        """Whether it is to stop at the next pose."""
        return self._pause.is_set()

    def check(self) -> None:
        """Raise `CancelledError` if it is to stop at once."""
        if self.cancel.is_set():
            raise CancelledError("aborted")


@contextmanager
def obeying_signals(control: Control) -> Iterator[None]:
    """Within the block, Ctrl-C pauses and a second one aborts; a request of the system to end aborts.

    Does nothing outside the main thread, where Python receives no signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupted(number: int, frame: FrameType | None) -> None:
        if control.pause_asked:
            control.abort()
        control.pause()

    def ended(number: int, frame: FrameType | None) -> None:
        control.abort()

    handlers = {signal.SIGINT: interrupted, signal.SIGTERM: ended}
    if hasattr(signal, "SIGHUP"):
        handlers[signal.SIGHUP] = ended
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
