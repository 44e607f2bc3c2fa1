"""How to reconstruct: the options, checked when they are made."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Literal, get_args

from instrument.files.validation import Problem, raise_if_any

Accuracy = Literal["draft", "normal", "best"]
Light = Literal["auto", "given", "collocated", "estimate"]
Parallax = Literal["auto", "on", "off"]
Palette = Literal["auto", "on", "colour", "off"]
Power = Literal["auto", "given", "estimate"]
Field = Literal["auto", "near", "far"]
Neighbours = Literal["auto", "on", "off"]

AUTO = "auto"

ACCURACIES: dict[Accuracy, int] = {"draft": 0, "normal": 2, "best": 4}
"""How often geometry is updated from the depth at the most; it ends where another update would move nothing."""

_WORDS = {
    "accuracy": Accuracy,
    "light": Light,
    "parallax": Parallax,
    "palette": Palette,
    "power": Power,
    "field": Field,
    "neighbours": Neighbours,
}


@dataclass(frozen=True)
class Options:
    """How to reconstruct; what is ``"auto"`` is chosen from evidence.

    Attributes
    ----------
    dictionary : str
        ``"auto"`` (parametric; Lambertian where camera and light stand far apart), ``"parametric"``, ``"lambert"``,
        ``"sgd"``, ``"abc"`` or a file of `halfangle dictionary build`.
    accuracy : {"draft", "normal", "best"}
        Most geometry updates, `ACCURACIES`.
    light : {"auto", "given", "collocated", "estimate"}
        Where the light stands: as the stack says, in the lens, as the highlights say from nothing, or as
        the stack says and refined from the highlights if it says that it is uncertain.
    parallax : {"auto", "on", "off"}
        Whether views are resampled to follow the depth.
    palette : {"auto", "on", "colour", "off"}
        Whether pixels are mixtures of few materials that the scene shares, found from pixels that were first solved
        each on its own ("on") or, for few views, from their colours ("colour"); or each on its own.
    power : {"auto", "given", "estimate"}
        Whether each view's light power is corrected by what the whole scene says.
    field : {"auto", "near", "far"}
        Whether directions and fall-off are each pixel's own or those of the centre.
    neighbours : {"auto", "on", "off"}
        Whether a normal is told by its neighbours' too, as strongly as the scene is smooth.
    independent : bool
        Pixels have nothing to do with each other: no depth.
    tolerance : float
        Gain in chi-square that an atom must bring, 0 or more.
    seed : int
        Of the draws of pixels for evidence and of the depth's sigma, 0 or more.
    threads : int or None
        None = all processors; the result is the same for any number.

    Raises
    ------
    InvalidInputError
        With every option that has a value which is not allowed.
    """

    dictionary: str = AUTO
    accuracy: Accuracy = "normal"
    light: Light = "auto"
    parallax: Parallax = "auto"
    palette: Palette = "auto"
    power: Power = "auto"
    field: Field = "auto"
    neighbours: Neighbours = "auto"
    independent: bool = False
    tolerance: float = 2.0
    seed: int = 0
    threads: int | None = None

    def __post_init__(self) -> None:
        raise_if_any("These options cannot be used.", self._problems())

    def _problems(self) -> Iterator[Problem]:
        for name, kind in _WORDS.items():
            yield from _word_problems(name, getattr(self, name), get_args(kind))
        if not isinstance(self.dictionary, str):
            yield _problem("dictionary", self.dictionary, "a name or the path of a file, as text")
        if not isinstance(self.independent, bool):
            yield _problem("independent", self.independent, "True or False")
        if not (_is_number(self.tolerance) and 0.0 <= self.tolerance < math.inf):
            yield _problem("tolerance", self.tolerance, "a number of 0 or more")
        if not (_is_whole(self.seed) and self.seed >= 0):
            yield _problem("seed", self.seed, "a whole number of 0 or more")
        if self.threads is not None and not (_is_whole(self.threads) and self.threads >= 1):
            yield _problem("threads", self.threads, "a whole number of 1 or more, or None for all processors")


def _word_problems(name: str, value: Any, allowed: tuple[str, ...]) -> Iterator[Problem]:
    if value in allowed:
        return
    close = get_close_matches(str(value).lower(), allowed, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    yield _problem(name, value, f"one of {', '.join(map(repr, allowed))}{hint}")


def _problem(name: str, value: Any, allowed: str) -> Problem:
    return Problem(name, f"is {value!r}; must be {allowed}")


def _is_number(value: Any) -> bool:
    return not isinstance(value, bool | str) and hasattr(value, "__float__")


def _is_whole(value: Any) -> bool:
    """Whether it is a whole number, also one of NumPy's."""
    try:
        operator.index(value)
    except TypeError:
        return False
    return not isinstance(value, bool)
