"""A progress bar with the time left on stderr; silent where stderr is not a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress


class Step(Protocol):
    """Moves a bar."""

    def __call__(self, done: float | None = None, message: str = "", total: float | None = None) -> None:
        """Show that `done` of `total` are done, and what happens now; None leaves a number as it is."""


@contextmanager
def progress_bar(description: str, total: float | None = None, console: Console | None = None) -> Iterator[Step]:
    """Show a bar while the block runs; the function it gives moves the bar.

    Parameters
    ----------
    description : str
        What takes so long, e.g. ``"capture"``.
    total : float, optional
        How much there is to do; may be told later.
    console : rich.console.Console, optional
        Where to draw; stderr by default.
    """
    console = console or Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[message]}"),
    )
    with RichProgress(*columns, console=console, disable=not console.is_terminal) as bars:
        task = bars.add_task(description, total=total, message="")

        def step(done: float | None = None, message: str = "", total: float | None = None) -> None:
            bars.update(task, completed=done, total=total, message=message)

        yield step
