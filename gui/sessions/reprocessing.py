"""Calibrate, reconstruct, report: the command itself, run beside the console, with its command line to be copied."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QLineEdit, QPushButton, QVBoxLayout, QWidget

from gui.sessions.next_step import Reprocessing, calibrating, reconstructing, reporting
from gui.widgets.actions import ActionButton
from gui.widgets.command import Command
from gui.widgets.job import Job
from gui.widgets.text import selectable

FINE = (0, 3)
"""Exit codes of a command that has done what it was asked for; 3 = with warnings."""

_LAST_LINES = 4  # of what a command said, that tell why it failed


class ReprocessingPanel(QWidget):
    """Runs one command at a time on the file that it is told."""

    line = Signal(str)  # the command line, and what the command prints
    failed = Signal(str)
    calibrated = Signal(Path)  # the session
    reconstructed = Signal(Path)  # the result
    ended = Signal()  # whatever came of it: there may be new files

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.calibrate_button = ActionButton("sessions.calibrate")
        self.reconstruct_button = ActionButton("sessions.reconstruct")
        self.report_button = ActionButton("sessions.report")
        self.end_button = QPushButton(self.tr("En&d the command"))
        self.command_edit = QLineEdit(readOnly=True)
        self.state_label = selectable(name=self.tr("State of the command"))
        self._source: Path | None = None
        self._job: Job | None = None
        self._command: Command | None = None
        self._done: Callable[[], None] = lambda: None
        self._said: deque[str] = deque(maxlen=_LAST_LINES)
        self._is_asked_to_end = False
        self._lay_out()
        self._wire()
        self.take(None)

    @property
    def is_busy(self) -> bool:
        """Whether a command runs, or is about to."""
        return self._job is not None or self._command is not None

    def take(self, source: Path | None) -> None:
        """Work on that file from now on."""
        self._source = source
        for button in (self.calibrate_button, self.reconstruct_button, self.report_button):
            button.setEnabled(source is not None and not self.is_busy)
        self.end_button.setEnabled(self._command is not None)

    def calibrate(self, session: Path) -> None:
        """Calibrate a session; nothing while another command runs."""
        self._prepare(lambda: calibrating(session), lambda _: self.calibrated.emit(session))

    def reconstruct(self, source: Path) -> None:
        """Reconstruct a session or a stack; nothing while another command runs."""
        self._prepare(lambda: reconstructing(source), self.reconstructed.emit)

    def report(self, source: Path) -> None:
        """Report the newest result; nothing while another command runs."""
        self._prepare(lambda: reporting(source), lambda _: None)

    def close_command(self) -> None:
        """End what runs, and wait until it has ended."""
        if self._job is not None:
            self._job.succeeded.disconnect()
            self._job.wait()
        if self._command is not None:
            self._command.close()

    def _prepare(self, find: Callable[[], Reprocessing], done: Callable[[Path], None]) -> None:
        if self.is_busy:
            return
        self._job = Job(lambda *_: find(), self)
        self._job.succeeded.connect(lambda found: self._run(found, done))
        self._job.failed.connect(self.failed)
        self._job.finished.connect(self._prepared)
        self.take(self._source)
        self._job.start()

    def _prepared(self) -> None:
        self._job = None
        self.take(self._source)

    def _run(self, found: Reprocessing, done: Callable[[Path], None]) -> None:
        self._done = lambda: done(found.made)
        self._said.clear()
        self._is_asked_to_end = False
        self._command = Command(found.arguments, self)
        self._command.line.connect(self._hear)
        self._command.ended.connect(self._finish)
        self.command_edit.setText(self._command.text)
        self.line.emit(self._command.text)
        self._command.start()
        self.take(self._source)

    def _hear(self, text: str) -> None:
        self._said.append(text)
        self.state_label.setText(text)
        self.line.emit(text)

    def _end(self) -> None:
        if self._command is not None:
            self._is_asked_to_end = True
            self.state_label.setText(self.tr("ending ..."))
            self._command.end()

    def _finish(self, code: int) -> None:
        command, self._command = self._command, None
        assert command is not None
        command.deleteLater()
        self.take(self._source)
        self.ended.emit()
        if code in FINE:
            self.state_label.setText(self.tr("done: {last}").format(last=self._said[-1] if self._said else ""))
            self._done()
        elif self._is_asked_to_end:
            self.state_label.setText(self.tr("ended before it was done"))
        else:
            what = self.tr("{command}\nended with exit code {code}:\n{said}")
            self.state_label.setText(self.tr("failed with exit code {code}").format(code=code))
            self.failed.emit(what.format(command=command.text, code=code, said="\n".join(self._said)))

    def _wire(self) -> None:
        for button, act in (
            (self.calibrate_button, self.calibrate),
            (self.reconstruct_button, self.reconstruct),
            (self.report_button, self.report),
        ):
            button.clicked.connect(lambda _=False, act=act: None if self._source is None else act(self._source))
        self.end_button.clicked.connect(self._end)

    def _lay_out(self) -> None:
        label = QLabel(self.tr("Command line"))
        label.setBuddy(self.command_edit)
        buttons = QHBoxLayout()
        for button in (self.calibrate_button, self.reconstruct_button, self.report_button):
            buttons.addWidget(button)
        buttons.addStretch()
        told = QHBoxLayout()
        told.addWidget(label)
        told.addWidget(self.command_edit, stretch=1)
        told.addWidget(self.end_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addLayout(buttons)
        column.addLayout(told)
        column.addWidget(self.state_label)
