"""What an experiment of the reproduction is: a name, what the supplement says, and what running it gives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

Row = dict[str, Any]


class Verdict(Enum):
    """Ours against what the supplement states; the value is the word for it."""

    BETTER = "better"
    EQUAL = "equal"
    WORSE = "worse"
    NOT_COMPARABLE = "not comparable"


class SkippedError(Exception):
    """An experiment cannot be run here: what is missing, and how to have it."""


@dataclass(frozen=True)
class Request:
    """How an experiment is to be run.

    Attributes
    ----------
    folder : Path
        Of this experiment alone; what it writes there may be found again by a later run of the same request.
    quick : bool
        Within the ten minutes that all experiments have together.
    seed : int
    merl : Path or None
        Folder of the MERL database's ``.binary`` files, where they are at hand.
    """

    folder: Path
    quick: bool
    seed: int
    merl: Path | None = None


@dataclass(frozen=True)
class Finding:
    """What an experiment found.

    Attributes
    ----------
    ours : str
        The figures that matter, in a line, each with its metric and unit.
    verdict : Verdict
    why : str
        Why the verdict is that; what the stand-in data can and cannot show.
    rows : sequence of dict
        The table, every row with the same keys; numbers stay numbers.
    figures : sequence of Path
        PNG files in the folder of the request, the first one for the page.
    """

    ours: str
    verdict: Verdict
    why: str
    rows: Sequence[Row] = field(default_factory=tuple)
    figures: Sequence[Path] = field(default_factory=tuple)


@dataclass(frozen=True)
class Experiment:
    """A row of the table of experiments.

    Attributes
    ----------
    name : str
        As on the command line.
    source : str
        Where in the supplement, e.g. ``"fig. 3"``.
    title : str
        What is measured, in a few words.
    stated : str
        What the supplement says of it.
    run : callable
        Takes a `Request`, returns a `Finding`; raises `SkippedError` where it cannot be run.
    """

    name: str
    source: str
    title: str
    stated: str
    run: Callable[[Request], Finding]
