"""The menus: every action with its keys, and the theme."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QCoreApplication, Signal
from PySide6.QtGui import QAction, QActionGroup
from PySide6.QtWidgets import QApplication, QMenuBar, QWidget

from gui.widgets.actions import CONTEXT, MENUS, ActionButton
from gui.widgets.theme import Theme, apply_theme


class MenuBar(QMenuBar):
    """Offers what the buttons offer, and gives the program its colours.

    Parameters
    ----------
    buttons : sequence of ActionButton
    parent : QWidget, optional
        As in Qt.
    """

    theme_chosen = Signal(object)  # Theme

    def __init__(self, buttons: Sequence[ActionButton], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        for name, title in MENUS.items():
            menu = self.addMenu(QCoreApplication.translate(CONTEXT, title))
            menu.addActions([button.menu_action for button in buttons if button.info.menu == name])
        view = self.addMenu(self.tr("&View"))
        self._themes = QActionGroup(self)
        for theme in Theme:
            action = QAction(QCoreApplication.translate("Theme", theme.value), self._themes, checkable=True)
            action.triggered.connect(lambda _, theme=theme: self.choose_theme(theme))
            view.addAction(action)

    @property
    def theme(self) -> Theme:
        """The theme that is chosen."""
        checked = self._themes.checkedAction()
        return Theme.SYSTEM if checked is None else list(Theme)[self._themes.actions().index(checked)]

    def choose_theme(self, theme: Theme) -> None:
        """Give the program the colours of a theme."""
        self._themes.actions()[list(Theme).index(theme)].setChecked(True)
        application = QApplication.instance()
        if isinstance(application, QApplication):
            apply_theme(application, theme)
        self.theme_chosen.emit(theme)
