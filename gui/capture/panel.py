"""What to capture, and how far it is: protocol, session, preflight, Start, Pause, Abort, Resume, progress."""

from __future__ import annotations

import math
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QFileDialog,
    QFormLayout,
    QGridLayout,
    QLineEdit,
    QProgressBar,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from gui.capture.bracket_strip import BracketStrip
from gui.capture.pose_view import PoseView
from gui.capture.poses import SeenPoses
from gui.widgets.actions import ActionButton
from gui.widgets.files import FileField
from gui.widgets.text import selectable
from protocols.capture.progress import Progress
from protocols.planning.plan import duration


class ProtocolPanel(QWidget):
    """Says what the operator asks for, and shows what it is told.

    Parameters
    ----------
    poses : SeenPoses
        Those of the capture.
    parent : QWidget, optional
        As in Qt.
    """

    plan_asked = Signal(Path)  # the protocol
    start_asked = Signal(Path, Path)  # the protocol, the session to write
    resume_asked = Signal(Path)  # the session
    pause_asked = Signal()
    abort_asked = Signal()

    def __init__(self, poses: SeenPoses, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.pose_view = PoseView(poses)
        self.bracket_strip = BracketStrip()
        poses.taken.connect(self.bracket_strip.show_pose)
        self.protocol_edit = QLineEdit(placeholderText="protocol.toml")
        self.session_edit = QLineEdit(placeholderText="session.h5")
        self.plan_button = ActionButton("capture.plan")
        self.start_button = ActionButton("capture.start")
        self.pause_button = ActionButton("capture.pause")
        self.abort_button = ActionButton("capture.abort")
        self.resume_button = ActionButton("capture.resume")
        self.bar = QProgressBar()
        self.outlook_label = selectable("", self.tr("What the capture would take"))
        self.state_label = selectable(self.tr("nothing has begun"), self.tr("How far the capture is"))
        # The plan's digest is one word that no line breaks: better its end is cut than the panel.
        policy = QSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        policy.setHeightForWidth(True)
        self.outlook_label.setSizePolicy(policy)
        font = self.state_label.font()
        font.setPointSizeF(1.2 * font.pointSizeF())
        font.setBold(True)
        # Not by a style sheet, which keeps the colours of the theme that it was set in.
        self.state_label.setFont(font)
        self._lay_out()
        self._wire()
        self.show_busy(busy=False)

    @property
    def protocol(self) -> Path:
        """The protocol that is named."""
        return Path(self.protocol_edit.text())

    @property
    def session(self) -> Path:
        """The session that is named."""
        return Path(self.session_edit.text())

    def show_busy(self, *, busy: bool) -> None:
        """Let be asked for what can be done: with the rig in use, or free."""
        has_protocol, has_session = bool(self.protocol_edit.text()), bool(self.session_edit.text())
        self.plan_button.setEnabled(not busy and has_protocol)
        self.start_button.setEnabled(not busy and has_protocol and has_session)
        self.resume_button.setEnabled(not busy and has_session)
        self.pause_button.setEnabled(busy)
        self.abort_button.setEnabled(busy)
        for edit in (self.protocol_edit, self.session_edit):
            edit.setReadOnly(busy)

    def show_progress(self, progress: Progress) -> None:
        """Show one report of a capture."""
        self.bar.setMaximum(max(progress.n_poses, 1))
        self.bar.setValue(progress.n_complete)
        text = self.tr("{n_complete} of {n_poses} poses, {n_frames} frames").format(
            n_complete=progress.n_complete, n_poses=progress.n_poses, n_frames=progress.n_frames
        )
        if not math.isnan(progress.remaining):
            text += self.tr("; about {time} left").format(time=duration(progress.remaining))
        self.state_label.setText(f"{progress.message}\n{text}")

    def show_outlook(self, text: str) -> None:
        """Show what a capture would do."""
        self.outlook_label.setText(text)

    def show_end(self, text: str) -> None:
        """Show how a capture ended."""
        self.state_label.setText(text)

    def _wire(self) -> None:
        for edit in (self.protocol_edit, self.session_edit):
            # Also while a capture runs a session may be chosen from the list, for later.
            edit.textChanged.connect(lambda _: self.show_busy(busy=self.pause_button.isEnabled()))
        self.plan_button.clicked.connect(lambda: self.plan_asked.emit(self.protocol))
        self.start_button.clicked.connect(lambda: self.start_asked.emit(self.protocol, self.session))
        self.resume_button.clicked.connect(lambda: self.resume_asked.emit(self.session))
        self.pause_button.clicked.connect(self.pause_asked)
        self.abort_button.clicked.connect(self.abort_asked)

    def _lay_out(self) -> None:
        form = QFormLayout()
        protocols, sessions = self.tr("Protocols (*.toml *.py)"), self.tr("Sessions (*.h5)")
        form.addRow(self.tr("Pro&tocol"), FileField(self.protocol_edit, protocols))
        form.addRow(self.tr("Sess&ion"), FileField(self.session_edit, sessions, QFileDialog.AcceptMode.AcceptSave))
        buttons = QGridLayout()
        for i, button in enumerate((self.start_button, self.pause_button, self.resume_button, self.abort_button)):
            buttons.addWidget(button, i // 2, i % 2)
        column = QVBoxLayout(self)
        column.addLayout(form)
        column.addWidget(self.plan_button)
        column.addWidget(self.outlook_label)
        column.addLayout(buttons)
        column.addWidget(self.bar)
        column.addWidget(self.state_label)
        column.addWidget(self.pose_view)
        column.addWidget(self.bracket_strip)
        column.addStretch()
