"""Pictures and plots: the same by keys as by mouse, in the colours of the window."""

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QPalette
from pytestqt.qtbot import QtBot

from gui.widgets.plots import Picture, Plot
from gui.widgets.text import selectable


@pytest.fixture
def picture(qtbot: QtBot) -> Picture:
    picture = Picture()
    qtbot.addWidget(picture)
    picture.resize(300, 300)
    picture.show_image(np.arange(60, dtype=np.uint8).reshape(6, 10))
    picture.show()
    return picture


def test_keys_move_the_cursor_within_the_picture_and_pick(picture: Picture, qtbot: QtBot):
    pointed, picked = [], []
    picture.pointed.connect(lambda *at: pointed.append(at))
    picture.picked.connect(lambda *at: picked.append(at))
    for key in (Qt.Key.Key_Down, Qt.Key.Key_Right, Qt.Key.Key_Up, Qt.Key.Key_Up, Qt.Key.Key_Return):
        qtbot.keyClick(picture, key)
    qtbot.keyClick(picture, Qt.Key.Key_Right, Qt.KeyboardModifier.ShiftModifier)
    assert pointed == [(1, 0), (1, 1), (0, 1), (0, 1), (0, 9)]
    assert picked == [(0, 1)]


def test_a_click_picks_the_pixel_under_the_mouse(picture: Picture, qtbot: QtBot):
    at = picture.mapFromScene(picture.box.mapViewToScene(picture.box.viewRect().center()))
    with qtbot.waitSignal(picture.picked) as picked:
        qtbot.mouseClick(picture.viewport(), Qt.MouseButton.LeftButton, pos=at)
    assert picked.args == [3, 5]


def test_keys_zoom_and_show_the_whole_again(picture: Picture, qtbot: QtBot):
    whole = picture.box.viewRect().width()
    qtbot.keyClick(picture, Qt.Key.Key_Plus)
    assert picture.box.viewRect().width() < whole
    qtbot.keyClick(picture, Qt.Key.Key_0)
    assert picture.box.viewRect().width() == pytest.approx(whole)


def test_the_first_row_is_on_top(picture: Picture):
    picture.show_image(np.repeat(np.array([[0], [255]], np.uint8), 2, axis=1))
    shown = picture.grab().toImage()
    middle = shown.width() // 2
    assert [shown.pixelColor(middle, shown.height() * i // 8).value() > 128 for i in (2, 6)] == [False, True]


@pytest.mark.parametrize("kind", [Picture, Plot])
def test_plots_follow_the_palette(kind: type[Picture | Plot], qtbot: QtBot):
    widget = kind()
    qtbot.addWidget(widget)
    palette = QPalette(widget.palette())
    palette.setColor(QPalette.ColorRole.Base, QColor("#123456"))
    widget.setPalette(palette)
    assert widget.backgroundBrush().color().name() == "#123456"


def test_labels_are_selectable_by_mouse_and_keyboard(qtbot: QtBot):
    label = selectable("<b>text</b>", "a name")
    flags = label.textInteractionFlags()
    assert flags & Qt.TextInteractionFlag.TextSelectableByMouse
    assert flags & Qt.TextInteractionFlag.TextSelectableByKeyboard
    assert label.textFormat() == Qt.TextFormat.PlainText
