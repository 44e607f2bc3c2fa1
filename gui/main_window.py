"""The operator's window: live picture, exposure time, the state of the light, and a STOP that cannot be missed."""

from __future__ import annotations

import logging
import signal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QSignalBlocker, Qt, QTimer
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QApplication,
    QDoubleSpinBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QMainWindow,
    QPushButton,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from drivers.camera import CameraDescription, Frame
from drivers.registry import open_devices
from gui.acquisition import Acquisition, Introduction, LightSign
from gui.banner import Banner
from gui.job import Job, Work
from gui.live_facts import LiveFacts, live_facts
from gui.live_view import LiveView
from gui.log_panel import LogPanel, LogRelay
from gui.newest import Newest
from gui.protocol_panel import ProtocolPanel
from gui.result_tab import ResultTab
from gui.rig_panel import RigPanel
from gui.rig_use import RigUse
from gui.sessions_tab import SessionsTab
from instrument.config import RigConfig
from instrument.rig import OpenDevices
from protocols import engine
from protocols.dry_run import Outlook, dry_run
from protocols.progress import Finish, Outcome, Progress, State
from protocols.python_protocol import load_any_protocol

MS = 1e-3
"""A millisecond in seconds."""

# To be read from two metres.
LIGHT_STYLES = {
    LightSign.OFF: "background: #20262c; color: #8fa3b3; font: bold 20px; padding: 10px",
    LightSign.ON: "background: #ffb000; color: black; font: bold 20px; padding: 10px",
    LightSign.UNKNOWN: "background: #d000b0; color: white; font: bold 20px; padding: 10px",
}
# A capture switches the light on and off for each pose: while it runs, the light may shine at any moment.
SIGNS = {state: LightSign.ON if state in (State.RUNNING, State.WARMUP) else LightSign.OFF for state in State} | {
    State.PREFLIGHT: LightSign.UNKNOWN,
    State.FINISHING: LightSign.UNKNOWN,
}
STOP_STYLE = "background: #c00000; color: white; font: bold 26px; padding: 18px"


class MainWindow(QMainWindow):
    """Mirrors an acquisition and sends to it; holds no state of its own.

    Parameters
    ----------
    config : RigConfig
        The rig to show; it is opened at once, dark.
    devices : callable, optional
        Makes the devices of `config`.
    """

    def __init__(self, config: RigConfig, devices: OpenDevices = open_devices) -> None:
        super().__init__()
        self.setWindowTitle(f"halfangle: {config.name}")
        self._config, self._devices = config, devices
        self.acquisition = Acquisition(config, devices, self)
        self.live_view = LiveView()
        self.live_analysis = Newest(_looked_at, self)
        self._camera: CameraDescription | None = None
        self.rig_panel = RigPanel()
        self.exposure_box = _exposure_box()
        self.read_back_label = QLabel()
        self.light_label = QLabel(alignment=Qt.AlignmentFlag.AlignCenter)
        self.connect_button = QPushButton("Connect")
        self.live_button = QPushButton("Live (light on)")
        self.stop_button = QPushButton("STOP (Esc)")
        self.stop_button.setStyleSheet(STOP_STYLE)
        self.banner = Banner()
        self.log_panel = LogPanel()
        self.sessions_tab = SessionsTab()
        self.result_tab = ResultTab()
        self._log_relay = LogRelay()
        # A stop can fall just before an exposure: it is repeated until the light is known to be off.
        self._until_dark = QTimer(self, interval=100)
        self.rig_use = RigUse(self.acquisition)
        self.protocol_panel = ProtocolPanel()
        self._lay_out()
        self._wire()
        self._show_light(LightSign.UNKNOWN)
        self.connect_rig()

    def connect_rig(self) -> None:
        """Open the rig in the acquisition's thread."""
        self._enable(connected=False)
        self.connect_button.setEnabled(False)
        self.rig_panel.show_state("connecting")
        self.acquisition.start()

    def stop(self) -> None:
        """Light off, exposure ended, capture aborted."""
        self.rig_use.abort()
        self.acquisition.stop()
        if self.acquisition.isRunning():
            self._until_dark.start()

    def closeEvent(self, event: QCloseEvent) -> None:
        """Leave the rig dark before the window goes."""
        logging.getLogger().removeHandler(self._log_relay)
        self.rig_use.close()
        self.acquisition.close()
        self.live_analysis.close()
        self.sessions_tab.close_job()
        self.result_tab.close_job()
        event.accept()

    def _wire(self) -> None:
        self.acquisition.opened.connect(self._show_rig)
        self.acquisition.frame_arrived.connect(self._show_frame)
        self.live_analysis.done.connect(lambda seen: self.live_view.show_frame(*seen))
        self.acquisition.exposure_time_read.connect(self._show_exposure_time)
        self.acquisition.light_changed.connect(self._show_light)
        self.acquisition.failed.connect(self._show_failure)
        self.acquisition.finished.connect(self._show_disconnected)
        self.exposure_box.valueChanged.connect(lambda value: self.acquisition.set_exposure_time(value * MS))
        self.connect_button.clicked.connect(self.banner.acknowledge)
        self.connect_button.clicked.connect(self.connect_rig)
        self._log_relay.carrier.logged.connect(self.log_panel.add)
        logging.getLogger().addHandler(self._log_relay)
        self.live_button.clicked.connect(self.acquisition.go_live)
        self.stop_button.clicked.connect(self.stop)
        QShortcut(QKeySequence(Qt.Key.Key_Escape), self).activated.connect(self.stop)
        self._until_dark.timeout.connect(self.acquisition.stop)
        self.rig_use.job_began.connect(self._follow)
        self.sessions_tab.chosen.connect(lambda path: self.protocol_panel.session_edit.setText(str(path)))
        self.rig_use.job_ended.connect(lambda: self.protocol_panel.show_busy(busy=False))
        self.protocol_panel.plan_asked.connect(self._plan)
        self.protocol_panel.start_asked.connect(self._capture)
        self.protocol_panel.resume_asked.connect(self._resume)
        self.protocol_panel.pause_asked.connect(self.rig_use.pause)
        self.protocol_panel.abort_asked.connect(self.rig_use.abort)

    def _plan(self, protocol: Path) -> None:
        self._begin(lambda watch, control: dry_run(self._config, load_any_protocol(protocol), self._devices))

    def _capture(self, protocol: Path, session: Path) -> None:
        self._begin(
            lambda watch, control: engine.capture(
                self._config, load_any_protocol(protocol), session, watch, self._devices, control
            )
        )

    def _resume(self, session: Path) -> None:
        self._begin(lambda watch, control: engine.resume(session, watch, self._devices, control))

    def _begin(self, work: Work) -> None:
        self.banner.acknowledge()
        self.protocol_panel.show_busy(busy=True)
        self.rig_use.begin(work)

    def _follow(self, job: Job) -> None:
        job.progressed.connect(self._show_progress)
        job.succeeded.connect(self._show_result)
        job.failed.connect(self._show_failure)

    def _show_progress(self, progress: Progress) -> None:
        self.protocol_panel.show_progress(progress)
        self._show_light(SIGNS[progress.state])
        self.log_panel.add(logging.INFO, progress.message)
        if progress.warning:
            self._show_failure(progress.warning)

    def _show_result(self, result: Outlook | Outcome) -> None:
        if isinstance(result, Outlook):
            self.protocol_panel.show_outlook(result.as_text())
            return
        self.protocol_panel.show_end(f"{result.path}: {result.n_complete} of {result.n_poses} poses, {result.message}")
        job = self.rig_use.job
        if result.finish is not Finish.COMPLETE and not (job is not None and job.stop_asked):
            self._show_failure(result.message)

    def _show_rig(self, rig: Introduction) -> None:
        camera = rig.camera
        self.rig_panel.show_rig(rig)
        self._camera = camera
        self.live_view.expect(camera)
        limits = camera.exposure_time_limits
        with QSignalBlocker(self.exposure_box):
            self.exposure_box.setRange(limits.low / MS, limits.high / MS)
        self.exposure_box.setToolTip(f"{limits.low:g} to {limits.high:g} {limits.unit}")
        self._enable(connected=True)

    def _show_frame(self, frame: Frame) -> None:
        if self._camera is not None:
            self.live_analysis.ask((frame, self._camera))
        # The next exposure goes on while this frame is looked at.
        self.acquisition.go_on()

    def _show_exposure_time(self, exposure_time: float) -> None:
        self.read_back_label.setText(f"{exposure_time / MS:.3f} ms")
        # Once the operator turns the box, an older read-back must not turn it back.
        if not self.exposure_box.isEnabled():
            with QSignalBlocker(self.exposure_box):
                self.exposure_box.setValue(exposure_time / MS)

    def _show_light(self, sign: LightSign) -> None:
        self.light_label.setText(sign.value)
        self.light_label.setStyleSheet(LIGHT_STYLES[sign])
        if sign is LightSign.OFF:
            self._until_dark.stop()

    def _show_failure(self, what: str) -> None:
        self.banner.tell(what)
        self.log_panel.add(logging.ERROR, what)

    def _show_disconnected(self) -> None:
        self._until_dark.stop()
        is_busy = self.rig_use.is_busy
        self.rig_panel.show_state("in use by the capture" if is_busy else "not connected")
        self._enable(connected=False)
        self.connect_button.setEnabled(not is_busy)

    def _enable(self, *, connected: bool) -> None:
        self.connect_button.setEnabled(not connected)
        self.live_button.setEnabled(connected)
        self.exposure_box.setEnabled(connected)

    def _lay_out(self) -> None:
        centre = QWidget()
        rows = QVBoxLayout(centre)
        columns = QHBoxLayout()
        columns.addLayout(self._left_column())
        self.tabs = QTabWidget()
        self.tabs.addTab(self.live_view, "Live")
        self.tabs.addTab(self.sessions_tab, "Sessions")
        self.tabs.addTab(self.result_tab, "Result")
        columns.addWidget(self.tabs, stretch=1)
        self.protocol_panel.setFixedWidth(320)
        columns.addWidget(self.protocol_panel)
        rows.addLayout(columns, stretch=1)
        rows.addWidget(self.banner)
        self.log_panel.setFixedHeight(110)
        rows.addWidget(self.log_panel)
        self.setCentralWidget(centre)
        self.resize(1280, 860)

    def _left_column(self) -> QVBoxLayout:
        form = QFormLayout()
        form.addRow("Exposure time", self.exposure_box)
        form.addRow("Read back", self.read_back_label)
        column = QVBoxLayout()
        column.addWidget(self.light_label)
        column.addWidget(self.rig_panel)
        column.addLayout(form)
        column.addWidget(self.connect_button)
        column.addWidget(self.live_button)
        column.addStretch()
        column.addWidget(self.stop_button)
        return column


def _looked_at(taken: tuple[Frame, CameraDescription]) -> tuple[NDArray[np.uint16], LiveFacts]:
    frame, camera = taken
    return frame.counts, live_facts(frame.counts, camera)


def _exposure_box() -> QDoubleSpinBox:
    box = QDoubleSpinBox(decimals=3, suffix=" ms", maximum=1e6)
    # A number half typed is no exposure time yet.
    box.setKeyboardTracking(False)
    box.setStepType(QAbstractSpinBox.StepType.AdaptiveDecimalStepType)
    return box


def run(config: RigConfig) -> int:
    """Show the window until it is closed, also by Ctrl-C; return Qt's exit code."""
    application = QApplication([])
    window = MainWindow(config)
    window.show()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: window.close())
    # Python sees to signals only while it runs, which it does not by itself inside Qt's loop.
    heartbeat = QTimer(interval=200)
    heartbeat.timeout.connect(lambda: None)
    heartbeat.start()
    return application.exec()
