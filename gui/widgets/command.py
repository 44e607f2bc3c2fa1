"""One command line of `halfangle` in a process of its own: its crash is not the console's, and no lock is shared."""

from __future__ import annotations

import os
import shlex
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, QProcess, QProcessEnvironment, QTimer, Signal

from instrument.files.validation import printable

CRASHED = -1
"""Exit code of a process that crashed, was killed, or could not be started."""

PATIENCE_MS = 5000
"""For which a process that was asked to end may clear away what it has begun."""

# Whoever is started in the background by a shell inherits that it is deaf to interrupts.
_HEAR = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "

# -P: a folder of strange files may hold a numpy.py, which must not be found there.
_PROGRAM = ("-P", "-u", "-c", _HEAR + "from cli.main import main; main()")


class Command(QObject):
    """Runs once.

    Parameters
    ----------
    arguments : sequence of str
        Of `halfangle`, without that word.
    parent : QObject, optional
        As in Qt.
    """

    line = Signal(str)  # what it prints, on either stream
    ended = Signal(int)  # its exit code, or `CRASHED`

    def __init__(self, arguments: Sequence[str], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._arguments = tuple(arguments)
        self._rest = b""
        self._process = QProcess(self)
        self._process.setProcessChannelMode(QProcess.ProcessChannelMode.MergedChannels)
        self._process.setProcessEnvironment(_environment())
        self._process.readyReadStandardOutput.connect(self._read)
        self._process.finished.connect(self._finish)
        self._process.errorOccurred.connect(self._fail)

    @property
    def text(self) -> str:
        """The command line, to be typed into a shell."""
        return shlex.join(["halfangle", *self._arguments])

    @property
    def is_running(self) -> bool:
        """Whether it has begun and not ended."""
        return self._process.state() is not QProcess.ProcessState.NotRunning

    def start(self) -> None:
        """Begin."""
        self._process.start(sys.executable, [*_PROGRAM, *self._arguments])

    def end(self) -> None:
        """Ask it to end, as Ctrl-C does, so that nothing half written is left; kill it where that takes too long."""
        if self.is_running:
            self._interrupt()
            QTimer.singleShot(PATIENCE_MS, self._process, self._process.kill)

    def close(self) -> None:
        """End it and wait until it has."""
        if self.is_running:
            self._process.blockSignals(True)
            self._interrupt()
            if not self._process.waitForFinished(PATIENCE_MS):
                self._process.kill()
                self._process.waitForFinished()

    def _interrupt(self) -> None:
        self._process.waitForStarted()
        if self.is_running and os.name == "posix":
            os.kill(self._process.processId(), signal.SIGINT)
        else:
            self._process.terminate()

    def _read(self) -> None:
        *lines, self._rest = (self._rest + bytes(self._process.readAllStandardOutput().data())).split(b"\n")
        for line in lines:
            self._say(line)

    def _say(self, line: bytes) -> None:
        text = printable(line.decode("utf-8", "replace").rstrip())
        if text:
            self.line.emit(text)

    def _finish(self, code: int, status: QProcess.ExitStatus) -> None:
        self._read()
        self._say(self._rest)
        self.ended.emit(code if status is QProcess.ExitStatus.NormalExit else CRASHED)

    def _fail(self, error: QProcess.ProcessError) -> None:
        # Whatever else happens to a process that has started ends it too.
        if error is QProcess.ProcessError.FailedToStart:
            self.line.emit(self._process.errorString())
            self.ended.emit(CRASHED)


def _environment() -> QProcessEnvironment:
    """Return an environment in which the very files are imported that this process runs."""
    environment = QProcessEnvironment.systemEnvironment()
    paths = [str(Path(__file__).resolve().parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment.insert("PYTHONPATH", os.pathsep.join(paths))
    environment.insert("PYTHONIOENCODING", "utf-8")
    return environment
