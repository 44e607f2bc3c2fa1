"""What a child process does for `child.in_child`: a task by name, with limits on memory and time."""

from __future__ import annotations

import json
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from typing import Any

from instrument.files.probe import look
from instrument.session_tools.examination import examine
from instrument.session_tools.summary import summaries
from instrument.session_tools.thumbnail import thumbnails

MEMORY_BYTES = 4 * 2**30
"""Address space of the child: four times the largest chunk that is read."""

TASKS: dict[str, Callable[..., Iterator[dict[str, Any]]]] = {
    "look": look,
    "summaries": summaries,
    "thumbnails": thumbnails,
    "examine": examine,
}


def main(step_seconds: str, task: str, *arguments: str) -> None:
    """Print what the task yields, a line of JSON each; no step may compute longer than `step_seconds`."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    # A crash is expected and no developer is to look into it.
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _start_step(float(step_seconds))
    for line in TASKS[task](*arguments):
        # This is how the parent is told.
        sys.stdout.write(f"{json.dumps(line)}\n")
        sys.stdout.flush()
        _start_step(float(step_seconds))


def _start_step(seconds: float) -> None:
    # Its signal ends the process, also in the middle of HDF5, where no exception would be raised.
    signal.setitimer(signal.ITIMER_PROF, seconds)


if __name__ == "__main__":
    main(*sys.argv[1:])
