"""The operator's window: what it is made of, and who hears whom."""

from __future__ import annotations

import logging

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import (
    QFrame,
    QMainWindow,
    QScrollArea,
    QSplitter,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from drivers.camera import Frame
from drivers.registry import open_devices
from gui.calibration.tab import CalibrationTab
from gui.capture.model import CaptureModel
from gui.capture.panel import ProtocolPanel
from gui.capture.poses import SeenPoses
from gui.capture.quick_look_tab import QuickLookTab
from gui.live.view import LiveView
from gui.result.tab import ResultTab
from gui.rig.acquisition import Acquisition, Introduction
from gui.rig.light_sign import SIGNS, LightLabel, LightSign
from gui.rig.live_controls import LiveControls
from gui.rig.rig_panel import RigPanel
from gui.rig.rig_use import RigUse
from gui.rig.stop import EscapeTwice, StopButton
from gui.sessions.tab import SessionsTab
from gui.widgets.actions import ActionButton
from gui.widgets.banner import Banner
from gui.widgets.log_panel import LogPanel, LogRelay
from gui.widgets.menu_bar import MenuBar
from instrument.config.rig import RigConfig
from instrument.rig.rig import OpenDevices
from protocols.capture.progress import Outcome, Progress
from protocols.planning.estimate import Outlook

_UNTIL_DARK_MS = 100
_NARROWEST = 200


class MainWindow(QMainWindow):
    """Mirrors a rig and what is done with it, and sends to them; holds no state of its own.

    Parameters
    ----------
    config : RigConfig
        The rig to show; it is opened at once, dark.
    devices : callable, optional
        Makes the devices of `config`.
    """

    closed = Signal()

    def __init__(self, config: RigConfig, devices: OpenDevices = open_devices) -> None:
        super().__init__()
        self.setWindowTitle(f"halfangle: {config.name}")
        self.acquisition = Acquisition(config, devices, self)
        self.rig_use = RigUse(self.acquisition)
        self.capture = CaptureModel(config, devices, self.rig_use)
        self.light_label = LightLabel()
        self.rig_panel = RigPanel()
        self.controls = LiveControls()
        self.stop_button = StopButton()
        self.live_view = LiveView(config.boards, config.camera.focal_length_px)
        self.sessions_tab = SessionsTab()
        self.calibration_tab = CalibrationTab()
        self.result_tab = ResultTab()
        poses = SeenPoses(self.capture)
        self.quick_look_tab = QuickLookTab(poses)
        self.protocol_panel = ProtocolPanel(poses)
        self.banner = Banner()
        self.log_panel = LogPanel()
        self._log_relay = LogRelay()
        self.escape = EscapeTwice(self)
        # A stop can fall just before an exposure: it is repeated until the light is known to be off.
        self._until_dark = QTimer(self, interval=_UNTIL_DARK_MS)
        self._lay_out()
        self.menus = MenuBar(self.findChildren(ActionButton), self)
        self.setMenuBar(self.menus)
        self._wire_rig()
        self._wire_capture()
        self._wire_files()
        self._wire_log()
        self.connect_rig()

    def connect_rig(self) -> None:
        """Open the rig in the acquisition's thread."""
        self.controls.show_connected(connected=False, can_connect=False)
        self.rig_panel.show_state(self.tr("connecting"))
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
        self.live_view.close_workers()
        self.quick_look_tab.close_worker()
        self.sessions_tab.close_job()
        self.calibration_tab.close_job()
        self.result_tab.close_job()
        self.closed.emit()
        event.accept()

    def _wire_rig(self) -> None:
        self.acquisition.opened.connect(self._show_rig)
        self.acquisition.frame_arrived.connect(self._show_frame)
        self.acquisition.exposure_time_read.connect(self.controls.show_exposure_time)
        self.acquisition.light_changed.connect(self._show_light)
        self.acquisition.warned.connect(self.show_warning)
        self.acquisition.failed.connect(self.show_failure)
        self.live_view.failed.connect(self.show_failure)
        self.acquisition.finished.connect(self._show_disconnected)
        self.controls.exposure_time_asked.connect(self.acquisition.set_exposure_time)
        self.controls.connect_button.clicked.connect(self.banner.acknowledge)
        self.controls.connect_button.clicked.connect(self.connect_rig)
        self.controls.live_button.clicked.connect(self.acquisition.go_live)
        self.stop_button.clicked.connect(self.stop)
        self.escape.pressed_twice.connect(self.stop_button.click)
        self.escape.pressed_once.connect(lambda: self.statusBar().showMessage(self.tr("Esc once more to STOP"), 1000))
        self._until_dark.timeout.connect(self.acquisition.stop)

    def _wire_capture(self) -> None:
        panel, capture = self.protocol_panel, self.capture
        panel.plan_asked.connect(capture.plan)
        panel.start_asked.connect(capture.start)
        panel.resume_asked.connect(capture.resume)
        panel.pause_asked.connect(capture.pause)
        panel.abort_asked.connect(capture.abort)
        capture.begun.connect(self.banner.acknowledge)
        capture.begun.connect(lambda: panel.show_busy(busy=True))
        capture.released.connect(lambda: panel.show_busy(busy=False))
        capture.progressed.connect(self._show_progress)
        capture.planned.connect(self._show_outlook)
        capture.ended.connect(self._show_outcome)
        capture.failed.connect(self.show_failure)
        self.quick_look_tab.failed.connect(self.show_failure)
        self.sessions_tab.chosen.connect(lambda path: panel.session_edit.setText(str(path)))

    def _wire_files(self) -> None:
        sessions, calibration, result = self.sessions_tab, self.calibration_tab, self.result_tab
        sessions.calibration_asked.connect(calibration.open_session)
        sessions.calibration_asked.connect(lambda _: self._turn_to(calibration))
        sessions.result_asked.connect(result.open_file)
        sessions.result_asked.connect(lambda _: self._turn_to(result))
        calibration.calibrate_asked.connect(sessions.calibrate)
        sessions.line.connect(lambda line: self.log_panel.add(logging.INFO, line))
        for tab in (sessions, calibration, result):
            tab.failed.connect(self.show_failure)

    def _turn_to(self, tab: QWidget) -> None:
        # Whoever watches the live picture goes on watching it.
        if self.tabs.currentWidget() is not self.live_view:
            self.tabs.setCurrentWidget(tab)

    def _wire_log(self) -> None:
        self._log_relay.carrier.logged.connect(self.log_panel.add)
        logging.getLogger().addHandler(self._log_relay)

    def show_failure(self, what: str) -> None:
        """Say in the banner and in the log what went wrong."""
        self.banner.tell(what)
        self.log_panel.add(logging.ERROR, what)

    def show_warning(self, what: str) -> None:
        """Say in the banner and in the log what should be known though all goes on."""
        self.banner.warn(what)
        self.log_panel.add(logging.WARNING, what)

    def _show_progress(self, progress: Progress) -> None:
        self.protocol_panel.show_progress(progress)
        self._show_light(SIGNS[progress.state])
        self.log_panel.add(logging.INFO, progress.message)
        if progress.warning:
            self.show_warning(progress.warning)

    def _show_outlook(self, outlook: Outlook) -> None:
        self.protocol_panel.show_outlook(outlook.as_text())

    def _show_outcome(self, outcome: Outcome) -> None:
        text = self.tr("{path}: {n_complete} of {n_poses} poses, {message}")
        self.protocol_panel.show_end(
            text.format(
                path=outcome.path, n_complete=outcome.n_complete, n_poses=outcome.n_poses, message=outcome.message
            )
        )

    def _show_rig(self, rig: Introduction) -> None:
        self.rig_panel.show_rig(rig)
        self.live_view.expect(rig.camera)
        self.controls.show_limits(rig.camera.exposure_time_limits)
        self.controls.show_connected(connected=True, can_connect=False)

    def _show_frame(self, frame: Frame) -> None:
        self.live_view.take(frame.counts)
        # The next exposure goes on while this frame is looked at.
        self.acquisition.go_on()

    def _show_light(self, sign: LightSign) -> None:
        self.light_label.show_sign(sign)
        if sign is LightSign.OFF:
            self._until_dark.stop()

    def _show_disconnected(self) -> None:
        self._until_dark.stop()
        is_busy = self.rig_use.is_busy
        self.rig_panel.show_state(self.tr("in use by the capture") if is_busy else self.tr("not connected"))
        self.controls.show_connected(connected=False, can_connect=not is_busy)

    def _lay_out(self) -> None:
        self.tabs = QTabWidget()
        self.tabs.addTab(self.live_view, self.tr("Live"))
        self.tabs.addTab(self.quick_look_tab, self.tr("Quick look"))
        self.tabs.addTab(self.sessions_tab, self.tr("Sessions"))
        self.tabs.addTab(self.calibration_tab, self.tr("Calibration"))
        self.tabs.addTab(self.result_tab, self.tr("Result"))
        self.columns = QSplitter(Qt.Orientation.Horizontal)
        for part in (self._left_column(), self.tabs, _scrolling(self.protocol_panel)):
            self.columns.addWidget(part)
        self.columns.setStretchFactor(1, 1)
        self.columns.setSizes([250, 750, 360])
        self.rows = QSplitter(Qt.Orientation.Vertical)
        self.rows.addWidget(self.columns)
        self.rows.addWidget(self.log_panel)
        self.rows.setStretchFactor(0, 1)
        self.rows.setSizes([700, 110])
        centre = QWidget()
        column = QVBoxLayout(centre)
        # Above all else, where the eye falls; it takes no room while there is nothing to say.
        column.addWidget(self.banner)
        column.addWidget(self.rows, stretch=1)
        self.setCentralWidget(centre)
        self.statusBar()
        self.resize(1360, 860)

    def _left_column(self) -> QWidget:
        devices = QWidget()
        rows = QVBoxLayout(devices)
        rows.addWidget(self.rig_panel)
        rows.addWidget(self.controls)
        rows.addStretch()
        left = QWidget()
        column = QVBoxLayout(left)
        column.setContentsMargins(0, 0, 0, 0)
        # What the light does, and STOP, never scroll out of sight.
        column.addWidget(self.light_label)
        column.addWidget(_scrolling(devices), stretch=1)
        column.addWidget(self.stop_button)
        return left


def _scrolling(widget: QWidget) -> QScrollArea:
    """Return an area that shows a widget at its natural width, and scrolls where there is too little room."""
    area = QScrollArea(widgetResizable=True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setWidget(widget)
    # Narrower than its widget wants to be: at 200 % a whole screen is 960 pixels wide.
    area.setMinimumWidth(_NARROWEST)
    return area
