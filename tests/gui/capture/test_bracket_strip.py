"""Thumbnails of a bracket."""

import pytest
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from gui.capture.bracket_strip import BracketStrip, Thumbnail
from tests.gui.told_poses import taken


@pytest.fixture
def strip(qtbot: QtBot) -> BracketStrip:
    strip = BracketStrip()
    qtbot.addWidget(strip)
    return strip


def texts(strip: BracketStrip) -> list[str]:
    return [label.text() for label in strip.findChildren(QLabel) if label is not strip.title_label]


def test_each_frame_has_its_exposure_time_and_how_much_of_it_clips(strip: BracketStrip):
    assert strip.isHidden()
    strip.show_pose(taken(6))
    assert strip.title_label.text() == "Frames of pose 7"
    assert texts(strip) == ["2 ms\n0 % clipped", "10 ms\n< 0.1 % clipped", "50 ms\n50 % clipped"]
    assert [shown.image.pixelColor(3, 3).value() for shown in strip.findChildren(Thumbnail)] == [10, 100, 255]


def test_the_next_pose_takes_the_place_of_the_last(strip: BracketStrip, qtbot: QtBot):
    strip.show_pose(taken(6))
    strip.show_pose(taken(7))
    qtbot.waitUntil(lambda: len(strip.findChildren(Thumbnail)) == 3)
    assert strip.title_label.text() == "Frames of pose 8"


def test_a_thumbnail_keeps_its_shape(strip: BracketStrip):
    strip.show_pose(taken(0))
    thumbnail = strip.findChildren(Thumbnail)[0]
    assert thumbnail.heightForWidth(80) == 60
    thumbnail.resize(80, 80)
    shown = thumbnail.grab().toImage()
    assert [shown.pixelColor(40, y).value() == 10 for y in (2, 40, 77)] == [False, True, False]
