"""A result in the window: its maps, the curve of a point, the light that is dragged."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pytestqt.qtbot import QtBot

from analysis.reconstruction import Options, reconstruct
from analysis.result import result_of, write_result
from benchmarks.scenes import relief
from gui.result_tab import MAPS, RELIT, ResultTab


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("results") / "relief.result.h5"
    reconstruction = reconstruct(relief(16, 25, 0.01, 1).stack, Options(palette="off"))
    write_result(path, result_of(reconstruction, [], {}, None))
    return path


@pytest.fixture
def tab(path: Path, qtbot: QtBot) -> Iterator[ResultTab]:
    tab = ResultTab()
    qtbot.addWidget(tab)
    with qtbot.waitSignal(tab.shown, timeout=20_000):
        tab.open_file(path)
    qtbot.waitUntil(lambda: not tab.is_busy)
    yield tab
    tab.close_job()


def test_every_map_is_a_picture_of_the_area(tab: ResultTab):
    pictures = []
    for name in MAPS:
        tab.map_box.setCurrentText(name)
        pictures.append(np.array(tab.picture.image))
        assert pictures[-1].shape == (16, 16, 3)
        assert pictures[-1].max() > 0
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)


def test_a_point_shows_its_curve_as_far_as_it_was_seen(tab: ResultTab):
    tab.pick(3, 5)
    assert tab.point_label.text().startswith("row 3, column 5: seen from ")
    assert len(tab.curve.getPlotItem().listDataItems()) == 6
    tab.pick(99, 5)
    assert tab.point_label.text().startswith("row 3, column 5")


def relit(tab: ResultTab, qtbot: QtBot, x: float) -> np.ndarray:
    with qtbot.waitSignal(tab._relighting.done, timeout=20_000):
        tab.relight(x, 0.0)
    return np.array(tab.picture.image).astype(int)


def test_the_light_comes_from_where_it_is_dragged_to(tab: ResultTab, qtbot: QtBot):
    with qtbot.waitSignal(tab._relighting.done, timeout=20_000):
        tab.map_box.setCurrentText(RELIT)
    assert (relit(tab, qtbot, -1.0) != relit(tab, qtbot, 1.0)).mean() > 0.5


def test_what_is_no_result_says_why(tab: ResultTab, tmp_path: Path, qtbot: QtBot):
    (tmp_path / "x.result.h5").write_bytes(b"nothing")
    tab.open_file(tmp_path / "x.result.h5")
    qtbot.waitUntil(lambda: "cannot be read" in tab.point_label.text(), timeout=20_000)
    assert tab.result is not None


def test_without_a_result_there_is_nothing_to_pick_or_relight(qtbot: QtBot):
    tab = ResultTab()
    qtbot.addWidget(tab)
    tab.pick(0, 0)
    tab.relight(0.0, 0.0)
    tab.map_box.setCurrentText("Depth")
    assert tab.picture.image is None
