"""The live picture: marks, tools and raw counts of frames that are made up."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from pytestqt.qtbot import QtBot

from drivers.camera import CameraDescription
from drivers.clock import RealClock
from drivers.limits import Limits
from drivers.simulated.devices import open_simulated
from gui.live.picture import BRIGHTEST, look_at
from gui.live.view import LiveView
from instrument.rig.frame_statistics import BLACK, CLIPPED, Counts
from tests.drivers.rigs import small_rig
from tests.gui.test_main_window import rig_config

HEIGHT, WIDTH, SATURATION = 120, 160, 4095.0
FOCAL_LENGTH = 1.93 * 640  # pixels of the frame with boards
CAMERA = CameraDescription("a", "b", "c", HEIGHT, WIDTH, 12, 64.0, SATURATION, "RGGB", 2.0, 3.0, Limits(1e-5, 1.0, "s"))


@pytest.fixture
def view(qtbot: QtBot) -> Iterator[LiveView]:
    view = LiveView(rig_config().boards, FOCAL_LENGTH)
    qtbot.addWidget(view)
    view.resize(700, 700)
    view.expect(CAMERA)
    view.show()
    yield view
    view.close_workers()


def even(level: int = 1000) -> Counts:
    return np.full((HEIGHT, WIDTH), level, dtype=np.uint16)


def show(view: LiveView, counts: Counts) -> None:
    view.show_look(look_at((counts, CAMERA, view.wanted)))
    view.show_plots()


def test_clipped_pixels_are_marked_and_no_others(view: LiveView):
    counts = even(int(SATURATION) - 1)
    counts[3, 5] = SATURATION
    show(view, counts)
    assert np.argwhere(view.picture.item.image > BRIGHTEST).tolist() == [[3, 5]]
    assert "0.01 % clipped" in view.facts_label.text()


def test_a_mark_that_is_switched_off_or_on_changes_the_frame_that_is_shown(view: LiveView, qtbot: QtBot):
    counts = even()
    counts[:2], counts[-2:] = SATURATION, 0
    show(view, counts)
    with qtbot.waitSignal(view.looking.done):
        view.switches[CLIPPED].click()
    qtbot.waitUntil(lambda: view.picture.item.image[0, 0] == BRIGHTEST)
    assert view.picture.item.image[-1, 0] == 0
    view.switches[BLACK].click()
    qtbot.waitUntil(lambda: view.picture.item.image[-1, 0] == BRIGHTEST + BLACK)


def test_the_histogram_has_a_logarithmic_axis_and_a_line_where_it_clips(view: LiveView):
    show(view, even())
    assert view.histogram.getPlotItem().getAxis("left").logMode
    assert view.histogram.clip_line.value() == SATURATION
    _, heights = view.histogram._curves["G"].getData()
    assert heights.max() == pytest.approx(np.log10(HEIGHT * WIDTH / 2))


def test_the_picture_shows_the_counts_between_the_ends_of_the_band(view: LiveView, qtbot: QtBot):
    counts = even()
    counts[:, :40], counts[:, 120:] = 500, 2000
    show(view, counts)
    view.histogram.set_window(500.0, 1500.0)
    qtbot.waitUntil(lambda: view.picture.item.image[0, 0] == 0)
    assert view.picture.item.image[0, 80] == BRIGHTEST // 2
    assert view.picture.item.image[0, 150] == BRIGHTEST


def test_two_counts_next_to_each_other_can_be_told_apart(view: LiveView, qtbot: QtBot):
    counts = even(1000)
    counts[:, 80:] = 1001
    view.histogram.set_window(998.0, 1003.0)
    show(view, counts)
    assert int(view.picture.item.image[0, 100]) - int(view.picture.item.image[0, 0]) == pytest.approx(
        BRIGHTEST / 5, abs=1
    )


def test_the_picture_stands_as_the_camera_sees_it(view: LiveView):
    counts = np.zeros((HEIGHT, WIDTH), dtype=np.uint16)
    counts[:60, :80] = SATURATION
    view.switches[CLIPPED].setChecked(False)
    show(view, counts)
    shown = view.picture.grab().toImage()
    x, y = shown.width() // 20, shown.height() // 20
    bright = [shown.pixelColor(i * x, j * y).value() > 128 for j in (8, 12) for i in (8, 12)]
    assert bright == [True, False, False, False]


def test_one_clipped_pixel_is_seen_in_a_picture_that_is_too_large_for_the_screen(view: LiveView):
    counts = even()
    counts[61, 83] = SATURATION
    look = look_at((counts, CAMERA, view.wanted._replace(step=4)))
    assert look.image.shape == (30, 40)
    assert np.argwhere(look.image == BRIGHTEST + CLIPPED).tolist() == [[15, 20]]
    view.show_look(look)
    assert view.picture.size_in_pixels == (HEIGHT, WIDTH)
    view.picture.set_cursor(61, 83)
    assert view.cursor_label.text() == "row 61, column 83: 4095 counts"


def test_a_mosaic_of_an_even_colour_is_an_even_picture_where_pixels_are_smaller_than_dots(view: LiveView):
    counts = even()
    counts[::2, ::2], counts[1::2, 1::2] = 3000, 200
    look = look_at((counts, CAMERA, view.wanted._replace(step=2)))
    assert len(np.unique(look.image)) == 1


def test_pixels_are_put_together_only_where_the_screen_has_too_few_dots(view: LiveView, qtbot: QtBot):
    show(view, even())
    assert view.wanted.step == 1
    view.expect(replace(CAMERA, height=4 * HEIGHT, width=16 * WIDTH))
    assert view.wanted.step == 4
    assert view.picture.pixels_per_dot == pytest.approx(16 * WIDTH / view.picture.width(), rel=0.1)


def test_the_zoom_stays_as_it_is_from_frame_to_frame_whatever_the_size(view: LiveView):
    odd = replace(CAMERA, height=HEIGHT + 1, width=WIDTH + 3)
    counts = np.full((HEIGHT + 1, WIDTH + 3), 1000, np.uint16)
    view.expect(odd)
    view.picture.box.scaleBy((0.5, 0.5))
    seen = view.picture.box.viewRect()
    for step in (1, 2, 4, 8):
        view.show_look(look_at((counts, odd, view.wanted._replace(step=step))))
        assert view.picture.box.viewRect() == seen


def test_what_the_operator_chose_to_see_stays_when_the_same_camera_is_connected_again(view: LiveView):
    view.histogram.set_window(500.0, 1500.0)
    view.expect(replace(CAMERA, firmware="1.1"))
    assert view.histogram.window_counts == (500.0, 1500.0)
    view.expect(replace(CAMERA, saturation_level=4000.0))
    assert view.histogram.window_counts == (64.0, 4000.0)


def test_a_frame_that_cannot_be_looked_at_is_told(view: LiveView, qtbot: QtBot):
    with qtbot.waitSignal(view.failed):
        view.take(np.zeros((0, 0), np.uint16))


def test_a_region_tells_of_its_pixels_alone(view: LiveView, qtbot: QtBot):
    counts = even()
    counts[20:40, 30:60] = 3000
    show(view, counts)
    view.region.setPos(30, 20)
    view.region.setSize((30, 20))
    view.region_switch.click()
    qtbot.waitUntil(lambda: view.facts_label.text().startswith("median 3000") or "3008" in view.facts_label.text())


def test_a_line_shows_the_raw_counts_along_it(view: LiveView, qtbot: QtBot):
    counts = even()
    counts[:, 80:] = 3000
    show(view, counts)
    assert not view.profile.isVisible()
    view.line_switch.click()
    assert view.profile.isVisible()
    distance, values = view.profile._curves["G"].getData()
    assert set(values) == {1000.0, 3000.0}
    assert distance.max() == pytest.approx(80.0, abs=2.0)


def test_the_cursor_tells_the_raw_count(view: LiveView):
    counts = even()
    counts[7, 9] = 1234
    show(view, counts)
    view.picture.set_cursor(7, 9)
    assert view.cursor_label.text() == "row 7, column 9: 1234 counts"


def test_the_plots_follow_the_picture_by_themselves(view: LiveView, qtbot: QtBot):
    view.show_look(look_at((even(), CAMERA, view.wanted)))
    view.show_look(look_at((even(2000), CAMERA, view.wanted)))
    qtbot.waitUntil(lambda: "2008" in view.facts_label.text())
    _, heights = view.histogram._curves["G"].getData()
    assert int(heights.argmax()) == 2000 * 256 // 4096


class TestBoards:
    def test_boards_are_found_where_they_are(self, view: LiveView, qtbot: QtBot, lit_frame: Counts):
        view.expect(replace(CAMERA, height=480, width=640))
        view.board_switch.click()
        view.take(lit_frame)
        qtbot.waitUntil(lambda: "boards in the picture" in view.boards.label.text(), timeout=20_000)
        assert view.boards.label.text().startswith("4 of 4 boards")
        # Inside a board each corner of a square has corners of markers next to it, if not all markers were read.
        found, expected = (np.stack([s.data["x"], s.data["y"]], 1) for s in (view.boards.found, view.boards.expected))
        assert len(expected) == 4 * 9
        assert np.quantile(np.linalg.norm(found[:, None] - expected, axis=2).min(axis=0), 0.9) < 5.0

    def test_a_picture_without_boards_says_so(self, view: LiveView, qtbot: QtBot):
        view.board_switch.click()
        view.take(even())
        qtbot.waitUntil(lambda: view.boards.label.text() == "0 of 4 boards in the picture", timeout=20_000)
        assert len(view.boards.found.data) == 0

    def test_nothing_is_looked_for_once_they_are_switched_off(self, view: LiveView, qtbot: QtBot):
        view.board_switch.click()
        view.board_switch.click()
        with qtbot.assertNotEmitted(view.boards.finding.done, wait=100):
            view.take(even())
        assert view.boards.label.text() == ""


@pytest.fixture
def lit_frame() -> Counts:
    rig = {**rig_config().model_dump(exclude_none=True), "camera": small_rig(640, 480)["camera"]}
    _, camera, light, stage = open_simulated(rig, RealClock())
    for device in (light, stage, camera):
        device.connect()
    stage.home()
    camera.set_exposure_time(0.02)
    light.on(1.0, 10.0)
    try:
        return camera.trigger().counts
    finally:
        light.off()
