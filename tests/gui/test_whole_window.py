"""What holds of every widget of the window: language, keyboard, size, and a command for each thing to do."""

import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import click
import pytest
from PySide6.QtCore import QCoreApplication, QDir, Qt, QTranslator
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QGroupBox,
    QHeaderView,
    QLabel,
    QLineEdit,
    QMenu,
    QPlainTextEdit,
    QScrollBar,
    QTabBar,
    QTableView,
    QToolButton,
    QWidget,
)
from pytestqt.qtbot import QtBot

from cli.main import COMMANDS, halfangle
from gui.main_window import MainWindow
from gui.widgets.actions import ACTIONS, GESTURES, ActionButton
from gui.widgets.files import FileField
from gui.widgets.plots import Picture
from tests.gui.test_main_window import Bench, rig_config

MIN_SCREEN = (960, 520)
"""Full HD at 200 %, less what a desktop keeps for itself."""

# What only a program or an analyst needs, and why no operator does.
COMMAND_ONLY = {
    "demo": "shows the whole chain without a rig",
    "devices": "finds what a rig file is to name, before there is one",
    "driver-test": "moves everything to its ends: nobody should do that by a click",
    "session info": "the list of sessions says it",
    "session pack": "changes no content",
    "session export": "for other programs",
    "session documents": "for other programs",
    "export": "for renderers and artists, after the rig",
    "relight": "as above",
    "boards": "printed once, before there is a rig",
    "import": "for pictures from elsewhere, without a rig",
    "dictionary build": "done once, not at the rig",
    "dictionary info": "as above",
    "dictionary list": "as above",
    "bench": "for who changes halfangle",
    "reproduce": "for who checks the method",
    "console": "opens the window",
}


# Buttons that concern the window alone, each with what it does.
WINDOW_ONLY = {
    "…": "opens a dialog for files",
    "Ac&knowledge": "hides the banner",
    "&Go on with it": "writes the session's name into the field for resuming",
    "Sho&w": "turns to the tab that shows it",
    "En&d the command": "is Ctrl-C to the command that runs",
    "Cali&brate": "the action of that name once more, where a calibration is missing",
}
# What is nobody's language: names of files, what a device says of itself, numbers and their units.
NOBODYS = re.compile(
    r"\W*|[\w.]+\.(toml|h5)|.* to .* (s|deg)|halfangle simulated \w+|sim-5|160 x 120, 12 bits|[\d. ]+ ms"
)
LINES = [*(action.command for action in ACTIONS.values()), *GESTURES.values()]


@pytest.fixture
def window(qtbot: QtBot) -> Iterator[MainWindow]:
    window = MainWindow(rig_config(), Bench().devices)
    window.show()
    qtbot.waitUntil(window.controls.live_button.isEnabled)
    yield window
    window.close()
    window.deleteLater()


def commands() -> dict[str, click.Command]:
    """All commands by their words."""
    context = click.Context(halfangle)
    found: dict[str, click.Command] = {}
    for name in COMMANDS:
        command = halfangle.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            found |= {f"{name} {sub}": command.commands[sub] for sub in command.commands}
        else:
            found[name] = command
    return found


def command_of(line: str) -> str:
    """The words of a command line that name the command."""
    words = line.split()
    assert words[0] == "halfangle"
    return next(known for known in (" ".join(words[1:3]), words[1].rstrip(":")) if known in commands())


class TestActions:
    @pytest.mark.parametrize("line", LINES)
    def test_each_has_a_command_that_is_there_with_its_options(self, line: str):
        options = {word for word in line.split() if word.startswith("-")}
        known = {name for option in commands()[command_of(line)].params for name in option.opts}
        assert options <= known

    def test_each_command_has_an_action_or_a_reason(self):
        twins = set(map(command_of, LINES))
        assert twins | set(COMMAND_ONLY) == set(commands())
        assert not twins & set(COMMAND_ONLY)

    def test_each_action_has_its_button_and_no_button_does_what_is_no_action(self, window: MainWindow):
        buttons = [b for b in window.findChildren(QAbstractButton) if is_ours(b)]
        assert sorted(b.objectName() for b in buttons if isinstance(b, ActionButton)) == sorted(ACTIONS)
        others = {b.text() for b in buttons if not isinstance(b, ActionButton) and not b.isCheckable()}
        assert others == set(WINDOW_ONLY)

    def test_each_action_stands_in_a_menu(self, window: MainWindow):
        in_menus = {action for menu in window.menuBar().findChildren(QMenu) for action in menu.actions()}
        assert {button.menu_action for button in window.findChildren(ActionButton)} <= in_menus

    def test_a_menu_offers_what_its_button_offers(self, window: MainWindow):
        for button in window.findChildren(ActionButton):
            assert button.menu_action.isEnabled() == button.isEnabled()

    def test_the_tip_of_a_button_is_its_command(self, window: MainWindow):
        for button in window.findChildren(ActionButton):
            assert button.toolTip() == ACTIONS[button.objectName()].command


class TestKeyboard:
    def test_all_that_can_be_done_can_be_reached_by_the_tab_key(self, window: MainWindow):
        operated = (
            QAbstractButton,
            QLineEdit,
            QComboBox,
            QAbstractSpinBox,
            QPlainTextEdit,
            QTableView,
            Picture,
            QTabBar,
        )
        for widget in filter(is_ours, window.findChildren(QWidget)):
            if isinstance(widget, operated) and not isinstance(widget, QToolButton):
                assert widget.focusPolicy() & Qt.FocusPolicy.TabFocus, describe(widget)

    def test_no_two_shortcuts_are_the_same(self, window: MainWindow):
        actions = [button.menu_action for button in window.findChildren(ActionButton)]
        keys = Counter(action.shortcut().toString() for action in actions)
        del keys[""]
        assert len(keys) >= 7
        assert set(keys.values()) == {1}

    def test_each_action_has_a_shortcut_or_a_letter(self, window: MainWindow):
        for button in window.findChildren(ActionButton):
            reached = button.info.shortcut or QKeySequence.mnemonic(button.text()).toString()
            assert reached or button is window.stop_button, button.text()

    def test_no_two_letters_after_alt_are_the_same_among_what_is_shown(self, window: MainWindow):
        for i_tab in range(window.tabs.count()):
            window.tabs.setCurrentIndex(i_tab)
            self.check_letters(window)

    def check_letters(self, window: MainWindow) -> None:
        letters: Counter[str] = Counter()
        for widget in filter(is_ours, window.findChildren(QWidget)):
            has_letter = isinstance(widget, QAbstractButton) or (isinstance(widget, QLabel) and widget.buddy())
            if has_letter and widget.isVisible():
                letters[QKeySequence.mnemonic(widget.text()).toString()] += 1
        letters += Counter(QKeySequence.mnemonic(a.text()).toString() for a in window.menuBar().actions())
        del letters[""]
        assert [letter for letter, n in letters.items() if n > 1] == [], window.tabs.tabText(window.tabs.currentIndex())

    def test_pictures_have_a_name_for_who_cannot_see_them(self, window: MainWindow):
        assert all(picture.accessibleName() for picture in window.findChildren(Picture))


class TestTexts:
    def test_every_label_can_be_selected_by_mouse_and_keyboard(self, window: MainWindow):
        flags = Qt.TextInteractionFlag.TextSelectableByMouse | Qt.TextInteractionFlag.TextSelectableByKeyboard
        for label in filter(is_ours, window.findChildren(QLabel)):
            if label.buddy() is None and label.text() and not is_heading_of_a_row(label):
                assert label.textInteractionFlags() & flags == flags, describe(label)

    def test_every_text_of_ours_is_translated(self, qtbot: QtBot, qapp: QApplication):
        translator = Brackets(qapp)
        qapp.installTranslator(translator)
        try:
            other = MainWindow(rig_config(), Bench().devices)
            other.show()
            qtbot.waitUntil(other.controls.live_button.isEnabled)
            untranslated = sorted({text for text in texts_of(other) if text and not is_translated(text)})
            other.close()
            other.deleteLater()
        finally:
            qapp.removeTranslator(translator)
        assert untranslated == []


class TestSize:
    def test_the_window_shrinks_to_a_small_screen_at_200_percent(self, window: MainWindow):
        smallest = window.minimumSizeHint()
        assert (smallest.width(), smallest.height()) <= MIN_SCREEN
        assert smallest.height() <= MIN_SCREEN[1]

    def test_what_matters_most_is_in_sight_on_the_smallest_screen(self, window: MainWindow, qtbot: QtBot):
        window.resize(*MIN_SCREEN)
        qtbot.wait(50)
        for widget in (window.light_label, window.stop_button):
            assert not widget.visibleRegion().isEmpty()
            assert widget.visibleRegion().boundingRect().size() == widget.size()


def test_nothing_is_modal(window: MainWindow, qtbot: QtBot):
    for field in window.findChildren(FileField):
        field.button.click()
        qtbot.waitUntil(field.dialog.isVisible)
        assert QApplication.activeModalWidget() is None
        assert not field.dialog.isModal()
        field.dialog.hide()


def test_a_file_chosen_in_a_dialog_comes_into_its_field(window: MainWindow):
    field = next(f for f in window.findChildren(FileField) if f.edit is window.protocol_panel.protocol_edit)
    field.dialog.fileSelected.emit(QDir.current().filePath("sweep.toml"))
    assert window.protocol_panel.protocol.name == "sweep.toml"


class Brackets(QTranslator):
    """Translates every text into itself between brackets."""

    def isEmpty(self) -> bool:  # noqa: N802
        return False

    def translate(self, context: str, sourceText: str, disambiguation: str | None = None, n: int = -1) -> Any:
        # Qt's own dialogs speak their language by Qt's own files.
        return f"⟦{sourceText}⟧" if context in our_contexts() else None


def our_contexts() -> set[str]:
    return {"Actions", "Theme", *(kind.__name__ for kind in our_classes(QWidget)), "BoardOverlay"}


def our_classes(kind: type) -> Iterator[type]:
    for sub in kind.__subclasses__():
        if sub.__module__.startswith("gui."):
            yield sub
        yield from our_classes(sub)


def texts_of(window: MainWindow) -> Iterator[str]:
    for widget in filter(is_ours, window.findChildren(QWidget)):
        yield widget.toolTip() if not isinstance(widget, ActionButton | QAbstractSpinBox) else ""
        yield widget.accessibleName()
        if isinstance(widget, QLineEdit) and not isinstance(widget.parent(), QAbstractSpinBox):
            yield widget.placeholderText()
        if isinstance(widget, QLabel | QAbstractButton):
            yield widget.text()
        if isinstance(widget, QGroupBox):
            yield widget.title()
        if isinstance(widget, QComboBox):
            yield from (widget.itemText(i) for i in range(widget.count()))
        if isinstance(widget, QTabBar):
            yield from (widget.tabText(i) for i in range(widget.count()))
        if isinstance(widget, QTableView) and widget.model() is not None:
            n_columns = widget.model().columnCount()
            yield from (str(widget.model().headerData(i, Qt.Orientation.Horizontal)) for i in range(n_columns))
    menus = [window.menuBar(), *window.menuBar().findChildren(QMenu)]
    yield from (action.text() for menu in menus for action in menu.actions())


def is_translated(text: str) -> bool:
    return all("⟦" in line or NOBODYS.fullmatch(line) for line in text.splitlines())


def is_ours(widget: QWidget) -> bool:
    """Whether a widget is in the window itself and none of Qt's making inside another."""
    parents = []
    parent: QWidget | None = widget
    while parent is not None:
        parents.append(parent)
        parent = parent.parentWidget()
    inside = (QDialog, QComboBox, QAbstractSpinBox, QHeaderView, QScrollBar, QTabBar)
    return not widget.objectName().startswith("qt_") and not any(isinstance(p, inside) for p in parents[1:])


def is_heading_of_a_row(label: QLabel) -> bool:
    """Whether a form made it."""
    return label.text() == QCoreApplication.translate("LiveControls", "Read back")


def describe(widget: QWidget) -> str:
    return f"{type(widget).__name__} {widget.objectName()} {getattr(widget, 'text', str)()!r}"
