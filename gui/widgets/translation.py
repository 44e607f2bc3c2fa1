"""Texts in the operator's language, read from Qt's own translation source (`translations/*.ts`)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, QTranslator

FOLDER = Path(__file__).parents[1] / "translations"


class SourceTranslator(QTranslator):
    """Reads what translators edit, so that nothing has to be compiled.

    Parameters
    ----------
    texts : dict
        Translations by context and text.
    parent : QObject, optional
        As in Qt.
    """

    def __init__(self, texts: dict[tuple[str, str], str], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._texts = texts

    def isEmpty(self) -> bool:
        """Tell Qt whether there is anything to ask for."""
        return not self._texts

    def translate(self, context: str, sourceText: str, disambiguation: str | None = None, n: int = -1) -> Any:
        """Return a text in the other language, None where it has none; Qt calls this."""
        # To Qt an empty text is a translation too, and the word would vanish.
        return self._texts.get((context, sourceText))


def read_translation(path: Path) -> dict[tuple[str, str], str]:
    """Return the finished translations of a `.ts` file by context and text.

    Raises
    ------
    OSError, xml.etree.ElementTree.ParseError
        If it cannot be read.
    """
    return {
        (context.findtext("name", ""), message.findtext("source", "")): message.findtext("translation", "")
        for context in ET.parse(path).getroot().iter("context")
        for message in context.iter("message")
        if message.find("translation[@type='unfinished']") is None
    }
