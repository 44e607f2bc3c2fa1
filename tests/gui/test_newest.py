"""Work on the newest that was asked for."""

from threading import Event

from pytestqt.qtbot import QtBot

from gui.newest import Newest


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
