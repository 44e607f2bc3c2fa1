"""A result in the window: its maps, the samples and the curve of a point, the light that is dragged."""

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt
from pytestqt.qtbot import QtBot

from analysis.evaluation.scoring import score
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from analysis.registration.stack import Stack
from analysis.registration.stack_file import write_stack
from analysis.results.points import USED, point_curve, point_samples
from analysis.results.result import Result, result_of
from analysis.results.result_file import read_result, write_result
from analysis.results.summary import SourceFile
from benchmarks.common.scenes import relief
from benchmarks.speed.watchdog import Watchdog
from gui.result.tab import RELIT, TITLES, ResultTab

SIZE = 16
CENTRE = QPointF(SIZE / 2, SIZE / 2)


@pytest.fixture(scope="module")
def stack() -> Stack:
    made = relief(SIZE, 25, 0.01, 1).stack
    saturated = np.zeros(made.radiance.shape, np.uint8)
    saturated[3, 3, 5] = 1
    return replace(made, saturated=saturated)


@pytest.fixture(scope="module")
def path(stack: Stack, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results")
    write_stack(folder / "relief.stack.h5", stack)
    digest = hashlib.sha256((folder / "relief.stack.h5").read_bytes()).hexdigest()
    source = SourceFile("relief.stack.h5", digest)
    reconstruction = reconstruct(stack, Options(palette="off"))
    write_result(
        folder / "relief.result.h5",
        result_of(reconstruction, [], replace(score(reconstruction, 0), source=source), None),
    )
    return folder / "relief.result.h5"


@pytest.fixture
def bare(qtbot: QtBot) -> Iterator[ResultTab]:
    tab = ResultTab()
    qtbot.addWidget(tab)
    tab.resize(900, 600)
    tab.show()
    yield tab
    tab.close_job()


@pytest.fixture
def tab(bare: ResultTab, path: Path, qtbot: QtBot) -> ResultTab:
    with qtbot.waitSignals([bare.shown, bare.drawing.done], timeout=60_000):
        bare.open_file(path)
    return bare


def choose(tab: ResultTab, qtbot: QtBot, name: str) -> np.ndarray:
    if tab.map_name != name:
        with qtbot.waitSignal(tab.drawing.done, timeout=20_000):
            tab.choose_map(name)
    return np.array(tab.picture.item.image)


def pick(tab: ResultTab, qtbot: QtBot, row: int, column: int) -> None:
    with qtbot.waitSignal(tab.point.sampling.done, timeout=20_000):
        tab.picture.picked.emit(row, column)


def test_every_map_is_a_picture_of_the_area(tab: ResultTab, qtbot: QtBot):
    pictures = [choose(tab, qtbot, name) for name in TITLES]
    assert all(picture.shape[:2] == (SIZE, SIZE) for picture in pictures)
    assert all(np.ptp(picture) > 0 for picture in pictures)
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)


def test_a_scale_has_a_bar_with_its_unit_and_colours_have_none(tab: ResultTab, qtbot: QtBot):
    assert not tab.bar.isVisible()
    for name, unit in (("depth", "Depth, mm"), ("normal sigma", "Sigma of the normals, deg")):
        choose(tab, qtbot, name)
        assert tab.bar.isVisible()
        assert tab.bar.getPlotItem().getAxis("left").labelText == unit


def test_the_value_under_the_cursor_is_that_of_the_map_that_is_chosen(tab: ResultTab, qtbot: QtBot, path: Path):
    result = read_result(path)
    tab.picture.set_cursor(7, 2)
    choose(tab, qtbot, "depth")
    assert tab.value_label.text() == f"row 7, column 2: {result.depth[7, 2]:.4g} mm"
    qtbot.keyClick(tab.picture, Qt.Key.Key_Down)
    assert tab.value_label.text() == f"row 8, column 2: {result.depth[8, 2]:.4g} mm"
    choose(tab, qtbot, "normals")
    x, y, z = result.normals[8, 2]
    assert tab.value_label.text() == f"row 8, column 2: ({x:.4g}, {y:.4g}, {z:.4g})"


def dots(tab: ResultTab, *, filled: bool) -> np.ndarray:
    items = [d for d in tab.point.plot.dots if (d.opts["symbolBrush"] is not None) == filled]
    return np.concatenate([np.stack(d.getOriginalDataset(), axis=1) for d in items if len(d.getOriginalDataset()[0])])


def test_a_point_shows_its_samples_against_its_curve(tab: ResultTab, qtbot: QtBot, path: Path, stack: Stack):
    pick(tab, qtbot, 3, 5)
    result = read_result(path)
    samples, curve = point_samples(result, stack, 3, 5), point_curve(result, 3, 5)
    is_used = samples.use == USED
    by_place = np.sort(np.rad2deg(np.repeat(samples.theta_h[:, None], 3, axis=1))[is_used])
    np.testing.assert_allclose(np.sort(dots(tab, filled=True)[:, 0]), by_place)
    np.testing.assert_allclose(np.sort(dots(tab, filled=True)[:, 1]), np.sort(samples.f[is_used]))
    assert len(dots(tab, filled=False)) == np.sum(~is_used) >= 3
    for shown, f in zip(tab.point.plot.curves, curve.f.T, strict=True):
        np.testing.assert_allclose(shown.getOriginalDataset()[1], f)
    np.testing.assert_allclose(tab.point.plot.seen_band.getRegion(), np.rad2deg(curve.seen))
    assert tab.point.curve_label.text().startswith("row 3, column 5: seen from ")
    assert f"normal known to {np.rad2deg(curve.normal_sigma):.2f} deg (one sigma)" in tab.point.curve_label.text()
    assert f"{is_used.sum()} samples used; 3 clipped" in tab.point.samples_label.text()


def test_the_point_that_is_picked_is_marked_in_the_map(tab: ResultTab, qtbot: QtBot):
    tab.picture.set_cursor(4, 9)
    with qtbot.waitSignal(tab.point.fitting.done, timeout=20_000):
        qtbot.keyClick(tab.picture, Qt.Key.Key_Return)
    assert all(np.ravel(item.getData()).tolist() == [9.5, 4.5] for item in tab.mark)


def test_without_its_stack_a_point_shows_its_curve_alone_and_says_why(
    bare: ResultTab, path: Path, tmp_path: Path, qtbot: QtBot
):
    (tmp_path / "relief.result.h5").write_bytes(path.read_bytes())
    with qtbot.waitSignal(bare.shown, timeout=60_000):
        bare.open_file(tmp_path / "relief.result.h5")
    with qtbot.waitSignal(bare.point.sampling.failed, timeout=20_000):
        bare.pick(3, 5)
    assert "put relief.stack.h5, which relief.result.h5 came from, beside it" in bare.point.samples_label.text()
    assert len(bare.point.plot.curves) == 3
    assert bare.point.plot.dots == []


def test_an_unsolved_point_says_so(bare: ResultTab, path: Path, tmp_path: Path, qtbot: QtBot):
    result: Result = read_result(path)
    for values in (result.fits.normals, result.fits.covariance, result.fits.theta_h_range):
        values[3 * SIZE + 5] = np.nan
    write_result(tmp_path / "holes.result.h5", result)
    with qtbot.waitSignal(bare.shown, timeout=60_000):
        bare.open_file(tmp_path / "holes.result.h5")
    with qtbot.waitSignal(bare.point.fitting.done, timeout=20_000):
        bare.pick(3, 5)
    assert bare.point.curve_label.text().startswith("row 3, column 5; unsolved")


def relit(tab: ResultTab, qtbot: QtBot, x: float) -> np.ndarray:
    with qtbot.waitSignal(tab.drawing.done, timeout=20_000):
        tab.light.move_to(x, 0.0)
    return np.array(tab.picture.item.image).astype(int)


def test_the_light_comes_from_where_it_is_moved_to(tab: ResultTab, qtbot: QtBot):
    choose(tab, qtbot, RELIT)
    assert (relit(tab, qtbot, -1.0) != relit(tab, qtbot, 1.0)).mean() > 0.5


def drag(tab: ResultTab, qtbot: QtBot, column: float, row: float) -> None:
    """Drag from the centre to a place of the picture."""
    view = tab.picture.viewport()
    start, end = (tab.picture.mapFromScene(tab.picture.box.mapViewToScene(p)) for p in (CENTRE, QPointF(column, row)))
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=start)
    qtbot.mouseMove(view, end)
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=end)


def test_the_light_is_where_it_is_dragged_to_and_the_picture_stays(tab: ResultTab, qtbot: QtBot):
    choose(tab, qtbot, RELIT)
    shown = tab.picture.box.viewRange()
    with qtbot.waitSignal(tab.drawing.done, timeout=20_000):
        drag(tab, qtbot, 0.75 * SIZE, 0.25 * SIZE)
    assert tab.light.place == pytest.approx((0.5, 0.5), abs=0.02)
    assert tab.picture.box.viewRange() == shown


def test_the_light_is_moved_by_keys_and_not_beyond_its_bounds(tab: ResultTab, qtbot: QtBot):
    choose(tab, qtbot, RELIT)
    x, y = tab.light.place
    for key in (Qt.Key.Key_Right, Qt.Key.Key_Up, Qt.Key.Key_Up):
        qtbot.keyClick(tab.picture, key)
    assert tab.light.place == pytest.approx((x + 0.1, y + 0.2))
    tab.light.move_to(5.0, -5.0)
    assert tab.light.place == (2.0, -2.0)


def test_the_light_stays_where_it_is_while_another_map_is_shown(tab: ResultTab, qtbot: QtBot):
    before = tab.light.place
    drag(tab, qtbot, 0.75 * SIZE, 0.25 * SIZE)
    qtbot.keyClick(tab.picture, Qt.Key.Key_Right)
    assert tab.light.place == before
    assert not tab.light.sign.isVisible()


def test_picking_and_drawing_leave_the_window_alive(tab: ResultTab, qtbot: QtBot):
    pick(tab, qtbot, 3, 5)
    watchdog = Watchdog()
    watchdog.begin()
    for i, name in enumerate(TITLES):
        choose(tab, qtbot, name)
        pick(tab, qtbot, i, i)
    watchdog.end()
    assert len(watchdog.delays) > 5
    # 50 ms are wanted; a busy machine takes longer, and a hang takes for ever.
    assert watchdog.longest < 2.0


def test_what_is_no_result_says_why_and_leaves_what_is_shown(tab: ResultTab, tmp_path: Path, qtbot: QtBot):
    (tmp_path / "x.result.h5").write_bytes(b"nothing")
    for name in ("x.result.h5", "gone.result.h5"):
        with qtbot.waitSignal(tab.failed, timeout=20_000) as failed:
            tab.open_file(tmp_path / name)
        assert name in failed.args[0]
        assert "cannot be read" in tab.state_label.text()
    assert tab.result is not None


def test_without_a_result_there_is_nothing_to_pick_or_relight(bare: ResultTab):
    bare.pick(0, 0)
    bare.choose_map(RELIT)
    bare.relight(0.0, 0.0)
    bare.choose_map("depth")
    assert bare.picture.item.image is None
    assert bare.point.plot.curves == []
