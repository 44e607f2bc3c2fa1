"""Problems of an input: checks yield them, a reader gathers them all and raises once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

LINE_BREAK = "\n"


def printable(text: str, keep: str = "") -> str:
    """Return a text from a file as a terminal may show it: what steers one, or hides text, is spelt out.

    Parameters
    ----------
    text : str
    keep : str
        Characters that are left as they are.
    """
    return "".join(c if c.isprintable() or c in keep else c.encode("unicode_escape").decode() for c in text)


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong with an input.

    Attributes
    ----------
    where : str
        File with line, or path inside a file, e.g. ``"rig.toml:12"`` or ``"/entry/stack/radiance"``.
    what : str
        What is wrong, what is allowed, what to do next.
    """

    where: str
    what: str

    def __str__(self) -> str:
        return f"{printable(self.where)}: {printable(self.what, keep=LINE_BREAK)}"


class InvalidInputError(ValueError):
    """An input cannot be used; holds every problem found, not the first one only."""

    def __init__(self, title: str, problems: Iterable[Problem]) -> None:
        self.title = title
        self.problems = tuple(problems)
        super().__init__("\n".join([title, *(f"  {problem}" for problem in self.problems)]))


def raise_if_any(title: str, problems: Iterable[Problem]) -> None:
    """Raise `InvalidInputError` with all `problems`, if there is one."""
    found = tuple(problems)
    if found:
        raise InvalidInputError(title, found)
