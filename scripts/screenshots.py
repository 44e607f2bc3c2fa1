"""Takes pictures of every tab of the console, light and dark, into docs/images/console: `make screenshots`.

The simulated rig of the examples is captured by the window itself; calibration and result are made by the commands
that its buttons run. Nothing is painted in afterwards.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from PIL import Image
from PySide6.QtCore import QBuffer, QEventLoop, QIODevice, QTimer
from PySide6.QtWidgets import QApplication, QWidget

from gui.main_window import MainWindow
from gui.widgets.theme import Theme, apply_theme
from instrument.config.loading import load_rig

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "images" / "console"
RIG, PROTOCOL = ROOT / "examples" / "simulated.toml", ROOT / "examples" / "quick_sweep.toml"
SIZE = (1360, 860)
N_COLOURS = 256
THEMES = {"light": Theme.LIGHT, "dark": Theme.DARK}
_PATIENCE_S = 300.0


def main() -> None:
    """Take them all."""
    application = QApplication(sys.argv[:1])
    PICTURES.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as name:
        folder = Path(name)
        os.chdir(folder)  # so that no picture shows a path of this machine
        window = MainWindow(load_rig(RIG))
        window.resize(*SIZE)
        window.show()
        for scene in scenes(window, folder):
            for theme, value in THEMES.items():
                apply_theme(application, value)
                settle(0.6)
                take(window, PICTURES / f"{scene}-{theme}.png")
        window.close()


def scenes(window: MainWindow, folder: Path) -> Iterator[str]:
    """Bring the window into each state in turn, and yield its name."""
    (folder / PROTOCOL.name).write_text(PROTOCOL.read_text(encoding="utf-8"), encoding="utf-8")
    panel = window.protocol_panel
    panel.protocol_edit.setText(PROTOCOL.name)
    panel.session_edit.setText("relief.h5")
    wait(window.controls.live_button.isEnabled)
    panel.plan_button.click()
    wait(lambda: not window.rig_use.is_busy and window.controls.live_button.isEnabled())
    yield from live(window)
    yield from capturing(window)
    yield from offline(window, folder)


def live(window: MainWindow) -> Iterator[str]:
    """Show the live picture with all that is drawn over it."""
    view = window.live_view
    window.tabs.setCurrentWidget(view)
    window.controls.exposure_box.setValue(16.0)
    for switch in (*view.switches.values(), view.board_switch, view.line_switch):
        switch.setChecked(True)
    window.controls.live_button.click()
    wait(lambda: view.boards.found.data.size > 0)
    yield "live"
    window.stop()
    wait(lambda: window.light_label.text().endswith("OFF"))


def capturing(window: MainWindow) -> Iterator[str]:
    """Show a capture half way, with its quick look, and a fault."""
    window.tabs.setCurrentWidget(window.quick_look_tab)
    window.protocol_panel.start_button.click()
    bar = window.protocol_panel.bar
    wait(lambda: bar.maximum() > 1 and bar.value() >= bar.maximum() // 2)
    window.protocol_panel.pause_button.click()
    wait(lambda: not window.rig_use.is_busy and window.controls.live_button.isEnabled())
    settle(3.0)
    yield "quick-look"
    window.protocol_panel.resume_button.click()
    wait(lambda: "complete" in window.protocol_panel.state_label.text())
    wait(lambda: not window.rig_use.is_busy and window.controls.live_button.isEnabled())


def offline(window: MainWindow, folder: Path) -> Iterator[str]:
    """Show sessions, calibration and result."""
    sessions = window.sessions_tab
    window.tabs.setCurrentWidget(sessions)
    sessions.look_button.click()
    wait(lambda: sessions.table.rowCount() > 0)
    sessions.table.selectRow(0)
    yield "sessions"
    sessions.reprocessing.calibrate_button.click()
    wait(lambda: not sessions.reprocessing.is_busy and window.calibration_tab.calibration is not None)
    window.tabs.setCurrentWidget(window.calibration_tab)
    yield "calibration"
    window.tabs.setCurrentWidget(sessions)
    sessions.table.selectRow(0)
    sessions.reprocessing.reconstruct_button.click()
    wait(lambda: not sessions.reprocessing.is_busy and window.result_tab.result is not None)
    result = window.result_tab
    window.tabs.setCurrentWidget(result)
    result.choose_map("normals")
    rows, columns = result.picture.size_in_pixels
    result.picture.set_cursor(rows // 3, columns // 3)
    result.pick(rows // 3, columns // 3)
    yield "result"
    drawn: list[object] = []
    result.drawing.done.connect(drawn.append)
    result.choose_map("relit")
    wait(lambda: bool(drawn))
    yield "relit"


def take(window: QWidget, path: Path) -> None:
    """Write a picture of the window, in few colours so that it stays small."""
    buffer = QBuffer()
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    window.grab().save(buffer, "PNG")
    image = Image.open(io.BytesIO(buffer.data().data())).convert("RGB")
    image.quantize(N_COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    sys.stdout.write(f"{path.relative_to(ROOT)} {path.stat().st_size / 1e3:.0f} kB\n")


def settle(seconds: float) -> None:
    """Let Qt's loop run for some seconds."""
    loop = QEventLoop()
    QTimer.singleShot(round(1e3 * seconds), loop.quit)
    loop.exec()


def wait(holds: Callable[[], bool]) -> None:
    """Let it run until something holds."""
    for _ in range(round(_PATIENCE_S / 0.05)):
        if holds():
            return
        settle(0.05)
    raise TimeoutError("what the picture is to show never came")


if __name__ == "__main__":
    main()
