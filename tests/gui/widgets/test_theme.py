"""Dark and light: what is written can be read."""

import itertools

import numpy as np
import pytest
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from analysis.drawing.colour_difference import ciede2000, lab_from_srgb
from gui.rig import light_sign
from gui.widgets import banner
from gui.widgets.plots import CHANNEL_COLOURS, OKABE_ITO, Plot
from gui.widgets.theme import Theme, apply_theme, palette_of

Role = QPalette.ColorRole
TEXT_ON = [
    (Role.WindowText, Role.Window),
    (Role.Text, Role.Base),
    (Role.Text, Role.AlternateBase),
    (Role.ButtonText, Role.Button),
    (Role.HighlightedText, Role.Highlight),
    (Role.ToolTipText, Role.ToolTipBase),
    (Role.PlaceholderText, Role.Base),
]


def luminance(colour: QColor) -> float:
    """Relative luminance of sRGB (WCAG 2.2)."""
    channels = [to_linear(c) for c in colour.getRgbF()[:3]]
    return sum(w * c for w, c in zip((0.2126, 0.7152, 0.0722), channels, strict=True))


def to_linear(c: float) -> float:
    """Linear light of a channel of sRGB."""
    return c / 12.92 if c <= 0.04045 else float(((c + 0.055) / 1.055) ** 2.4)


def contrast(one: QColor, other: QColor) -> float:
    """Contrast ratio (WCAG 2.2)."""
    darker, lighter = sorted((luminance(one), luminance(other)))
    return (lighter + 0.05) / (darker + 0.05)


@pytest.mark.parametrize("theme", [Theme.LIGHT, Theme.DARK])
@pytest.mark.parametrize(("text", "ground"), TEXT_ON)
def test_text_stands_out_from_its_ground(theme: Theme, text: Role, ground: Role):
    palette = palette_of(theme)
    assert contrast(palette.color(text), palette.color(ground)) >= 4.5


@pytest.mark.parametrize("style", [banner.FAULT_STYLE, banner.WARNING_STYLE, *light_sign._STYLES.values()])
def test_signs_stand_out_in_any_theme(style: str):
    colours = {part.split(":")[0].strip(): QColor(part.split(":")[1].strip()) for part in style.split(";")}
    assert contrast(colours["background"], colours["color"]) >= 4.5


@pytest.mark.parametrize("theme", [Theme.LIGHT, Theme.DARK])
def test_curves_can_be_seen(theme: Theme):
    base = palette_of(theme).color(Role.Base)
    assert all(contrast(QColor(colour), base) >= 2.5 for colour in CHANNEL_COLOURS.values())


# Viénot, Brettel and Mollon 1999: linear sRGB as a dichromat sees it.
DICHROMATS = {
    "protan": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]],
    "deutan": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]],
}


@pytest.mark.parametrize("sight", DICHROMATS)
def test_marks_are_told_apart_without_red_or_green_sight(sight: str):
    linear = np.array([[to_linear(c) for c in QColor(colour).getRgbF()[:3]] for colour in OKABE_ITO.values()])
    seen = np.clip(linear @ np.array(DICHROMATS[sight]).T, 0.0, 1.0)
    names = list(OKABE_ITO)
    used = [names.index(name) for name in ("vermillion", "blue", "yellow", "purple", "sky blue")]
    display = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)
    one, other = np.array(list(itertools.combinations(used, 2))).T
    colours = lab_from_srgb(display)
    assert ciede2000(colours[one], colours[other]).min() > 10.0


def test_a_theme_reaches_plots_that_are_there_already(qtbot: QtBot, qapp: QApplication):
    plot = Plot()
    qtbot.addWidget(plot)
    plot.show()
    for theme in (Theme.DARK, Theme.LIGHT):
        apply_theme(qapp, theme)
        base = palette_of(theme).color(Role.Base)
        qtbot.waitUntil(lambda base=base: plot.backgroundBrush().color() == base)


def test_the_desktop_decides_where_the_operator_does_not(qapp: QApplication):
    apply_theme(qapp, Theme.SYSTEM)
    assert qapp.palette().color(Role.Window) in [palette_of(t).color(Role.Window) for t in (Theme.LIGHT, Theme.DARK)]
