"""Work on the newest that was asked for."""

import time
from threading import Event

from pytestqt.qtbot import QtBot

from gui.widgets.newest import Newest


def test_what_comes_while_it_works_is_left_out_but_for_the_newest(qtbot: QtBot):
    go_on, done = Event(), []

    def work(what: int | None) -> int | None:
        go_on.wait(10.0)
        return what

    newest = Newest(work)
    newest.done.connect(done.append)
    newest.ask(0)
    qtbot.waitUntil(newest.isRunning)
    qtbot.waitUntil(lambda: not newest._newest)
    for i in range(1, 6):
        newest.ask(i)
    newest.ask(None)
    go_on.set()
    qtbot.waitUntil(lambda: done == [0, None])
    newest.close()
    assert not newest.isRunning()


def test_an_error_is_told_and_the_next_work_is_done(qtbot: QtBot):
    failed, done = [], []
    newest = Newest(lambda x: 1 / x)
    newest.failed.connect(failed.append)
    newest.done.connect(done.append)
    newest.ask(0)
    qtbot.waitUntil(lambda: failed == ["division by zero"])
    newest.ask(2)
    qtbot.waitUntil(lambda: done == [0.5])
    newest.close()


def test_a_rest_does_not_keep_it_from_closing(qtbot: QtBot):
    newest = Newest(lambda _: time.sleep(0.01), rest=1e6)
    with qtbot.waitSignal(newest.done):
        newest.ask(None)
    began = time.monotonic()
    newest.close()
    assert time.monotonic() - began < 5.0
