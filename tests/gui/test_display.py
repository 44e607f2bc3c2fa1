"""Where no window can be shown, it is said before Qt is asked, which would end the process by a signal."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from gui.display import display_problem

pytestmark = pytest.mark.skipif("sys.platform != 'linux'", reason="other desktops are always there")


def test_no_display_is_none() -> None:
    assert "neither DISPLAY nor WAYLAND_DISPLAY is set" in (display_problem({}) or "")


@pytest.mark.parametrize("display", [":4711", "no-such-host:0", "nonsense"])
def test_a_display_that_has_gone_is_named(display: str) -> None:
    assert f"nothing answers at DISPLAY={display}" in (display_problem({"DISPLAY": display}) or "")


def test_a_library_that_the_system_lacks_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gui.display._XCB_LIBRARIES", ("libxcb.so.1", "libnowhere.so.7"))
    assert "needs libnowhere.so.7 of the system" in (display_problem({"DISPLAY": ":0"}) or "")


def test_a_wayland_desktop_is_there_while_its_socket_is(tmp_path: Path) -> None:
    environment = {"WAYLAND_DISPLAY": "w", "XDG_RUNTIME_DIR": str(tmp_path)}
    assert "nothing answers at WAYLAND_DISPLAY=w" in (display_problem(environment) or "")
    with socket.socket(socket.AF_UNIX) as desktop:
        desktop.bind(str(tmp_path / "w"))
        assert display_problem(environment) is None


@pytest.mark.parametrize("platform", ["offscreen", "minimal:x"])
def test_what_qt_draws_without_a_screen_needs_none(platform: str) -> None:
    assert display_problem({"QT_QPA_PLATFORM": platform}) is None
