"""The marker boards over the live picture: what was found, and where it should be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QObject
from PySide6.QtWidgets import QWidget

from drivers.camera import CameraDescription
from gui.widgets.newest import Newest
from gui.widgets.plots import OKABE_ITO, Picture
from gui.widgets.text import selectable
from instrument.config.boards import BoardConfig

if TYPE_CHECKING:
    from analysis.camera.live_boards import SeenBoards

_REST = 2.0
"""Finding boards takes longer than a frame: it leaves two thirds of a core to the picture."""


class BoardOverlay(QObject):
    """Draws into a picture; `label` says what was found in words.

    Parameters
    ----------
    picture : Picture
    boards : sequence of BoardConfig
    focal_length_px : float
        Nominal.
    parent : QWidget
    """

    def __init__(
        self, picture: Picture, boards: Sequence[BoardConfig], focal_length_px: float, parent: QWidget
    ) -> None:
        super().__init__(parent)
        self.label = selectable("", self.tr("Boards in the live picture"))
        self.finding = Newest(lambda asked: _see(asked, boards, focal_length_px), self, rest=_REST)
        self._n_boards = len(boards)
        self.found = _marks("o", OKABE_ITO["sky blue"])
        self.expected = _marks("+", OKABE_ITO["purple"])
        for marks in (self.found, self.expected):
            picture.box.addItem(marks)
        self.finding.done.connect(self._show)
        self._is_on = False

    def switch_to(self, *, on: bool) -> None:
        """Show what is found from now on, or nothing."""
        self._is_on = on
        self.label.setVisible(on)
        self.label.setText(self.tr("looking for the boards") if on else "")
        for marks in (self.found, self.expected):
            marks.setVisible(on)
            marks.clear()

    def take(self, counts: NDArray[np.uint16], camera: CameraDescription) -> None:
        """Look for the boards in a frame of raw counts, shape (H, W), when there is time."""
        self.finding.ask((counts, camera.bayer_pattern))

    def close(self) -> None:
        """Join the thread."""
        self.finding.close()

    def _show(self, seen: SeenBoards) -> None:
        if not self._is_on:
            return
        # Pixels are counted from their centres there, from their corners here.
        self.found.setData(pos=seen.found + 0.5)
        self.expected.setData(pos=seen.expected + 0.5)
        text = self.tr("{seen} of {all} boards in the picture").format(seen=seen.n_boards, all=self._n_boards)
        if np.isfinite(seen.rms_px):
            text += self.tr("; corners {rms:.2f} px off where the rig file has them").format(rms=seen.rms_px)
        self.label.setText(text)


def _see(asked: tuple[NDArray[np.uint16], str], boards: Sequence[BoardConfig], focal_length_px: float) -> SeenBoards:
    # Imported here, in the worker, since it takes as long as opening the window.
    from analysis.camera.live_boards import see_boards

    return see_boards(*asked, [board.record for board in boards], focal_length_px)


def _marks(symbol: str, colour: str) -> pg.ScatterPlotItem:
    return pg.ScatterPlotItem(symbol=symbol, size=9, pen=pg.mkPen(colour, width=1.5), brush=None)
