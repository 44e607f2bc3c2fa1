"""How fast the console is: the time until its window shows, and what it makes of a live picture.

`python -m benchmarks.speed.console` prints, for frames of 2.3 Mpixel and 12 bits from a camera that has a new one ready
at any time, with every overlay switched on:

- updates: pictures that were painted a second;
- blocked: the longest time for which the window's thread listened to nobody, and the 99th percentile;
- load: how busy the process kept the cores;
- opens: seconds from the import of Qt to a window that is painted.

Qt's platform is the one that the environment says (`QT_QPA_PLATFORM`); without a display it is `offscreen`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QEventLoop, QObject, QTimer
from PySide6.QtWidgets import QApplication

from benchmarks.speed.watchdog import Watchdog
from drivers.camera import Frame
from drivers.clock import RealClock
from drivers.registry import Devices
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.devices import open_simulated
from drivers.simulated.world import World
from gui.main_window import MainWindow
from instrument.config.loading import load_rig
from instrument.config.rig import RigConfig

HEIGHT, WIDTH = 1200, 1920

RIG = Path("examples/simulated.toml")

_N_FRAMES = 8

_WARM_UP_S = 3.0

OPENING = """
import sys
import time
import PySide6.QtCore, PySide6.QtGui, PySide6.QtWidgets
began = time.perf_counter()
from pathlib import Path
from PySide6.QtCore import QEvent, QObject
from PySide6.QtWidgets import QApplication
from gui.main_window import MainWindow
from instrument.config.loading import load_rig

class Painted(QObject):
    def eventFilter(self, watched, event):
        if event.type() == QEvent.Type.Paint:
            print(time.perf_counter() - began, flush=True)
            window.removeEventFilter(self)
            window.close()
        return False

application = QApplication([])
window = MainWindow(load_rig(Path("examples/simulated.toml")))
painted = Painted()
window.installEventFilter(painted)
window.show()
application.exec()
"""


@dataclass(frozen=True)
class LiveSpeed:
    """What became of a live picture.

    Attributes
    ----------
    updates : float
        Pictures painted a second.
    longest_block, usual_block : float
        Seconds for which the window's thread listened to nobody: the longest, and the 99th percentile.
    load : float
        Cores that the process kept busy.
    """

    updates: float
    longest_block: float
    usual_block: float
    load: float

    def as_text(self) -> str:
        """Return a line for whoever measures."""
        return (
            f"updates {self.updates:.1f} a second; blocked {1e3 * self.longest_block:.0f} ms at most, "
            f"{1e3 * self.usual_block:.0f} ms in 99 of 100; load {self.load:.2f} cores"
        )


class ReadyCamera(SimulatedCamera):
    """Rendered its frames beforehand: it has one as soon as the exposure is over."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._ready: list[NDArray[np.uint16]] = []
        self._frame: Frame | None = None

    def trigger(self) -> Frame:
        """Expose, and deliver the next frame."""
        if self._frame is None:
            # Two, since the first is rendered while the light comes up.
            self._frame = [super(ReadyCamera, self).trigger() for _ in range(2)][1]
            rng = np.random.default_rng(0)
            noise = rng.integers(-20, 21, (_N_FRAMES, *self._frame.counts.shape), dtype=np.int16)
            self._ready = [np.clip(self._frame.counts + n, 0, 4095).astype(np.uint16) for n in noise]
        time.sleep(self._frame.exposure_time)
        self._ready.append(self._ready.pop(0))
        return Frame(**{**_fields(self._frame), "counts": self._ready[0].copy()})


class _Paints(QObject):
    """Counts how often what it watches is painted."""

    n = 0

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Count, and hide nothing; Qt calls this."""
        self.n += event.type() == QEvent.Type.Paint
        return False


def large_rig() -> RigConfig:
    """Return the example's rig with a camera of 2.3 Mpixel."""
    config = load_rig(RIG)
    camera = config.camera.model_copy(
        update={"width": WIDTH, "height": HEIGHT, "focal_length_px": 2.0 * config.camera.focal_length_px}
    )
    return config.model_copy(update={"camera": camera})


def ready_devices(rig: Mapping[str, Any]) -> Devices:
    """Return the simulated devices of a rig, with a camera that renders beforehand."""
    world, _, light, stage = open_simulated(rig, RealClock())
    return Devices(ReadyCamera(world), light, stage, world.clock)


def switch_everything_on(window: MainWindow) -> None:
    """Show every mark, the boards, a region and a line."""
    view = window.live_view
    for switch in (*view.switches.values(), view.board_switch, view.region_switch, view.line_switch):
        switch.setChecked(True)


def measure_live(window: MainWindow, seconds: float) -> LiveSpeed:
    """Let a window that is live go on for some seconds, and say what became of it."""
    paints, watchdog = _Paints(), Watchdog()
    window.live_view.picture.viewport().installEventFilter(paints)
    cpu, began = time.process_time(), time.perf_counter()
    watchdog.begin()
    spin(seconds)
    watchdog.end()
    took = time.perf_counter() - began
    window.live_view.picture.viewport().removeEventFilter(paints)
    load = (time.process_time() - cpu) / took
    return LiveSpeed(paints.n / took, watchdog.longest, float(np.quantile(watchdog.delays, 0.99)), load)


def spin(seconds: float, until: Callable[[], bool] = lambda: False) -> None:
    """Let Qt's loop run for some seconds, or until something holds."""
    loop, ticks = QEventLoop(), QTimer(interval=20)
    ticks.timeout.connect(lambda: loop.quit() if until() else None)
    ticks.start()
    QTimer.singleShot(round(1e3 * seconds), loop.quit)
    loop.exec()


def opening_seconds() -> float:
    """Return how long a new process takes from the import of Qt to a window that is painted."""
    done = subprocess.run([sys.executable, "-c", OPENING], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[0])


def _fields(frame: Frame) -> dict[str, Any]:
    return {name: getattr(frame, name) for name in frame.__dataclass_fields__}


def main() -> None:
    """Print the figures."""
    os.environ.setdefault("QT_QPA_PLATFORM", "xcb" if os.environ.get("DISPLAY") else "offscreen")
    application = QApplication(sys.argv[:1])
    window = MainWindow(large_rig(), ready_devices)
    window.resize(1600, 1000)
    window.show()
    switch_everything_on(window)
    spin(30.0, window.controls.live_button.isEnabled)
    window.controls.live_button.click()
    spin(60.0, lambda: window.live_view.boards.found.data.size > 0)
    spin(_WARM_UP_S)
    sys.stdout.write(f"{application.platformName()}, {os.cpu_count()} cores: {measure_live(window, 10.0).as_text()}\n")
    window.close()
    sys.stdout.write(f"opens in {', '.join(f'{opening_seconds():.2f}' for _ in range(3))} s\n")


if __name__ == "__main__":
    main()
