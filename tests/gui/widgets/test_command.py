"""Commands run beside the console, with what they print, and end when they are asked to."""

import os
import sys
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from gui.widgets import command as module
from gui.widgets.command import CRASHED, Command

CHILD = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
print('begun', flush=True)
{}
"""


def run(command: Command, qtbot: QtBot) -> tuple[int, list[str]]:
    lines: list[str] = []
    command.line.connect(lines.append)
    with qtbot.waitSignal(command.ended, timeout=30_000) as ended:
        command.start()
    return ended.args[0], lines


def program(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    monkeypatch.setattr(module, "_PROGRAM", ("-c", CHILD.format(code)))


def test_a_command_says_its_lines_and_its_exit_code(qtbot: QtBot):
    code, lines = run(Command(["dictionary", "info", "parametric"]), qtbot)
    assert code == 0
    assert any("lambert" in line for line in lines)


def test_what_went_wrong_comes_with_the_code_for_it(qtbot: QtBot, tmp_path: Path):
    code, lines = run(Command(["report", str(tmp_path / "no such.h5"), "-o", str(tmp_path / "p.html")]), qtbot)
    assert code == 2
    assert any("no such.h5" in line for line in lines)


def test_its_text_can_be_typed_into_a_shell():
    assert Command(["report", "my result.h5"]).text == "halfangle report 'my result.h5'"


def test_a_crash_is_told_and_ends_nothing_else(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch):
    program(monkeypatch, "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    assert run(Command([]), qtbot) == (CRASHED, ["begun"])


def test_a_program_that_is_not_there_is_told(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    assert run(Command([]), qtbot)[0] == CRASHED


def test_a_last_line_without_an_end_and_signs_that_steer_terminals_are_shown(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
):
    program(monkeypatch, r"sys.stdout.write('\x1b[2J half')")
    assert run(Command([]), qtbot) == (0, ["begun", r"\x1b[2J half"])


def begun(qtbot: QtBot) -> tuple[Command, list[str]]:
    """Start a command and wait for its second line."""
    command, lines = Command([]), []
    command.line.connect(lines.append)
    command.start()
    qtbot.waitUntil(lambda: len(lines) == 2, timeout=30_000)
    return command, lines


def test_it_ends_as_by_ctrl_c_and_may_clear_away(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    code = f"""
try:
    print('ready', flush=True)
    time.sleep(60)
finally:
    open({str(tmp_path / "cleared")!r}, 'w')
"""
    program(monkeypatch, code)
    command, _ = begun(qtbot)
    with qtbot.waitSignal(command.ended, timeout=10_000):
        command.end()
    assert (tmp_path / "cleared").exists()
    assert not command.is_running


def test_one_that_does_not_listen_is_killed(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "PATIENCE_MS", 200)
    program(monkeypatch, "signal.signal(signal.SIGINT, signal.SIG_IGN); print('deaf', flush=True); time.sleep(60)")
    command, _ = begun(qtbot)
    with qtbot.waitSignal(command.ended, timeout=10_000) as ended:
        command.end()
    assert ended.args == [CRASHED]


def test_closing_waits_until_it_is_gone(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch):
    program(monkeypatch, "print(__import__('os').getpid(), flush=True); time.sleep(60)")
    command, lines = begun(qtbot)
    command.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int(lines[1]), 0)
