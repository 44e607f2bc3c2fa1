"""The console on a screen, with a mouse: X's own server, its own events, nothing of Qt replaced."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from instrument.session.session import Session
from tests.cli.test_capture import PROTOCOL, RIG
from tests.gui.told_console import ToldConsole

SIZE = (1600, 1000)


@pytest.fixture
def screen() -> Iterator[str]:
    """Start a display nobody sees, and give its name."""
    if missing := [name for name in ("Xvfb", "xdotool") if shutil.which(name) is None]:
        pytest.skip(f"missing: {', '.join(missing)}; apt install xvfb xdotool")
    read, write = os.pipe()
    size = "x".join(map(str, (*SIZE, 24)))
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", size, "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as told:
        number = told.readline().strip()
    assert number, "no display"
    yield f":{number}"
    server.terminate()
    server.wait()


class Mouse:
    """Moves and clicks by the X server's own events."""

    def __init__(self, display: str) -> None:
        self._environment = os.environ | {"DISPLAY": display}

    def do(self, *words: str | int) -> None:
        subprocess.run(["xdotool", *map(str, words)], env=self._environment, check=True, timeout=20)

    def click(self, place: tuple[int, int]) -> None:
        self.do("mousemove", *place, "click", 1)

    def write(self, place: tuple[int, int], text: str) -> None:
        """Click into a field and type over what it holds."""
        self.click(place)
        self.do("key", "ctrl+a")
        self.do("type", "--delay", 2, text)


@pytest.fixture
def console(screen: str, tmp_path: Path) -> Iterator[ToldConsole]:
    (tmp_path / "rig.toml").write_text(RIG.replace("small bench", "bench on a screen"))
    (tmp_path / "protocol.toml").write_text(PROTOCOL)
    environment = {"QT_QPA_PLATFORM": "xcb", "DISPLAY": screen}
    console = ToldConsole(tmp_path, ["console", "--rig", str(tmp_path / "rig.toml")], environment)
    yield console
    if console.process.poll() is None:
        console.process.kill()
        console.process.communicate()


def test_a_whole_capture_by_mouse_and_keyboard(console: ToldConsole, screen: str, tmp_path: Path):
    mouse = Mouse(screen)
    console.wait_until(lambda told: "rig.live" in told["enabled"])
    mouse.click(console.place_of("rig.live"))
    console.wait_until(lambda told: told["light"] == "LIGHT ON" and "median" in told["frames"])
    mouse.click(console.place_of("rig.stop"))
    console.wait_until(lambda told: told["light"] == "LIGHT OFF")
    mouse.write(console.place_of("protocol"), str(tmp_path / "protocol.toml"))
    mouse.write(console.place_of("session"), str(tmp_path / "session.h5"))
    console.wait_until(lambda told: "capture.start" in told["enabled"])
    mouse.click(console.place_of("capture.start"))
    told = console.wait_until(lambda told: "3 of 3 poses, complete" in told["state"])
    assert told["banner"] == ""
    console.wait_until(lambda told: told["light"] == "LIGHT OFF" and "rig.live" in told["enabled"])
    with Session(tmp_path / "session.h5") as session:
        assert session.pose_complete.all()


def test_escape_twice_on_the_keyboard_puts_the_light_out(console: ToldConsole, screen: str):
    mouse = Mouse(screen)
    console.wait_until(lambda told: "rig.live" in told["enabled"])
    mouse.click(console.place_of("rig.live"))
    console.wait_until(lambda told: told["light"] == "LIGHT ON")
    mouse.do("key", "Escape")
    mouse.do("key", "Escape")
    console.wait_until(lambda told: told["light"] == "LIGHT OFF")
