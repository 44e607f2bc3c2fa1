"""Progress bars with the time left on stderr; where that is no terminal, the names of stages only."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress

if TYPE_CHECKING:
    from analysis.stages import Stages, Track

Item = TypeVar("Item")


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
    with _bars(console or Console(stderr=True)) as bars:
        task = bars.add_task(description, total=total, message="")

        def step(done: float | None = None, message: str = "", total: float | None = None) -> None:
            bars.update(task, completed=done, total=total, message=message)

        yield step


@contextmanager
def stage_bars(*, quiet: bool = False, console: Console | None = None) -> Iterator[Stages]:
    """Give the stages of a run, each of which shows a bar while it is under way.

    Parameters
    ----------
    quiet : bool
        Show nothing.
    console : rich.console.Console, optional
        Where to draw; stderr by default. Where it is no terminal, the name of each stage is printed as it begins.
    """
    from analysis.stages import Stages

    console = console or Console(stderr=True)
    if quiet:
        yield Stages()
    elif not console.is_terminal:
        yield Stages(line_printer(console))
    else:
        with _bars(console) as bars:
            shown = _ShownStages(bars)
            yield Stages(shown.begin, shown.advance)
            shown.end()


@contextmanager
def run_bar(description: str, *, quiet: bool = False) -> Iterator[tuple[Callable[[str], None], Track]]:
    """Give what prints lines above a bar, and what moves the bar over the parts of a run.

    Parameters
    ----------
    description : str
    quiet : bool
        Show nothing.
    """
    from analysis.stages import untracked

    console = Console(stderr=True)
    if quiet:
        yield lambda _: None, untracked
    else:
        with _bars(console) as bars:
            task = bars.add_task(description, total=None, message="")

            def track(items: Sequence[Item]) -> Iterator[Item]:
                return iter(bars.track(items, task_id=task))

            yield line_printer(console), track


def line_printer(console: Console) -> Callable[[str], None]:
    """Return what prints a line as it is, above the bars if there are any."""
    return lambda text: console.print(f"  {text} ...", highlight=False, markup=False, soft_wrap=True)


class _ShownStages:
    """A bar for each stage that was begun; one that comes again starts anew."""

    def __init__(self, bars: RichProgress) -> None:
        self._bars = bars
        self._tasks: dict[str, TaskID] = {}
        self._now: TaskID | None = None

    def begin(self, name: str) -> None:
        self.end()
        if name in self._tasks:
            self._bars.reset(self._tasks[name], total=None)
        else:
            self._tasks[name] = self._bars.add_task(name, total=None, message="")
        self._now = self._tasks[name]

    def advance(self, done: int, total: int) -> None:
        if self._now is not None:
            self._bars.update(self._now, completed=done, total=total)

    def end(self) -> None:
        """Let the bar of the stage that was under way show that it is done."""
        if self._now is not None:
            total = self._bars.tasks[self._bars.task_ids.index(self._now)].total
            self._bars.update(self._now, completed=total or 1, total=total or 1)
            self._bars.stop_task(self._now)


def _bars(console: Console) -> RichProgress:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[message]}"),
    )
    return RichProgress(*columns, console=console, disable=not console.is_terminal)
