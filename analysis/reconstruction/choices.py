"""What was modelled, and why: every optional effect is a choice made from evidence, or forced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

Value = TypeVar("Value")

FORCED = "forced by option"


@dataclass(frozen=True, slots=True)
class Choice:
    """One effect that could be modelled or not.

    Attributes
    ----------
    effect : str
        E.g. ``"parallax"``.
    chosen : str
        E.g. ``"on"``.
    reason : str
        The evidence with its numbers, or ``"forced by option"``.
    """

    effect: str
    chosen: str
    reason: str


@dataclass(frozen=True, slots=True)
class Chosen(Generic[Value]):
    """What follows from a choice, and the choice to record."""

    value: Value
    choice: Choice
