"""Reads mutated files, each in a forked process of its own, as a command does: looked at first, then read.

``python -m tests.strangers.trial FOLDER FIRST COUNT SOURCE...`` prints JSON: how many ended in which way, and of each
that must not be its kind, its seed, the mutation and what happened.
"""

import json
import os
import resource
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from analysis.reflectance.dictionary import by_name
from analysis.reflectance.models import Cosines
from analysis.registration.stack_file import is_stack, read_stack
from analysis.reporting.result_report import write_report
from analysis.results.result_file import read_result
from instrument.files.probe import look
from instrument.files.validation import InvalidInputError
from instrument.session.session import Session
from instrument.session_tools.summary import summarise_here
from tests.strangers.mutations import mutate
from tests.verifying import verify_session

MEMORY_BYTES = 3 * 2**30
STEP_SECONDS = 1.0
"""Of computing; a sound file takes a hundredth."""

FINE, REFUSED, CONTAINED, FAILED = "fine", "refused", "contained", "failed"
_CODES = {0: FINE, 10: REFUSED, 11: CONTAINED}


def use_session(path: Path) -> None:
    summarise_here(path)
    problems = list(verify_session(path))
    assert all(str(problem) for problem in problems)
    with Session(path) as session:
        for name in dir(type(session)):
            if isinstance(getattr(type(session), name), property):
                with suppress(InvalidInputError):
                    getattr(session, name)
        for i_pose in range(session.n_poses):
            with suppress(InvalidInputError):
                session.frames(i_pose)
                session.preview(i_pose)
    if problems:
        raise InvalidInputError("flagged", problems)


def use_stack(path: Path) -> None:
    is_stack(path)
    stack = read_stack(path)
    assert stack.radiance[0].shape == stack.radiance.shape[1:]


def use_result(path: Path) -> None:
    result = read_result(path)
    result.render(np.array([0.0, 0.0, 350.0]), np.array([0.0, 30.0, 350.0]))
    # Pictures take a second and show numbers that were looked at already; one in eight is enough.
    if crc32(path.read_bytes()) % 8 == 0:
        page = path.with_suffix(".html")
        page.unlink(missing_ok=True)
        write_report(page, result, "title")


def use_dictionary(path: Path) -> None:
    by_name(str(path)).evaluate(Cosines.on_slice(np.linspace(0, 1.5, 5)))


READERS: dict[str, Callable[[Path], None]] = {
    "session": use_session,
    "stack": use_stack,
    "result": use_result,
    "dictionary": use_dictionary,
}


def ending(work: Callable[[], int]) -> tuple[int, str]:
    """Run `work` in a forked process with limits; return its exit code, or minus a signal, and what it wrote."""
    with tempfile.TemporaryFile() as said:
        pid = os.fork()
        if pid == 0:
            _limit()
            os.dup2(said.fileno(), 2)
            os.dup2(said.fileno(), 1)
            os._exit(_code(work))
        _, status = os.waitpid(pid, 0)
        said.seek(0)
        text = said.read().decode(errors="replace")
    return (-os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)), text


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # For what waits without computing.
    signal.alarm(60)
    step()


def step() -> None:
    signal.setitimer(signal.ITIMER_PROF, STEP_SECONDS)


def _code(work: Callable[[], int]) -> int:
    try:
        return work()
    except InvalidInputError:
        return 10
    except BaseException:
        traceback.print_exc()
        return 1


def trial(kind: str, path: Path) -> tuple[str, str]:
    """Return how reading a file ends, and with what words if it must not end so."""

    def first_look() -> int:
        for said in look(str(path)):
            step()
            if "problem" in said:
                return 11
        return 0

    def reading() -> int:
        signal.setitimer(signal.ITIMER_PROF, 20 * STEP_SECONDS)
        READERS[kind](path)
        return 0

    code, text = ending(first_look)
    if code < 0 or code == 11:
        return CONTAINED, ""
    if code:
        return FAILED, text
    code, text = ending(reading)
    return (_CODES[code], "") if code in _CODES else (FAILED, f"{code} {text}")


def trials(kind: str, source: Path, folder: Path, seeds: range) -> Iterator[tuple[int, str, str, str]]:
    path = folder / source.name
    for seed in seeds:
        how = mutate(source, path, seed)
        yield (seed, how, *trial(kind, path))


def main(folder: str, first: str, count: str, *sources: str) -> None:
    """Try `count` mutations of each file in `sources`, which are named KIND.h5."""
    seeds = range(int(first), int(first) + int(count))
    numbers: Counter[str] = Counter()
    failures: list[Any] = []
    for source in map(Path, sources):
        READERS[source.stem](source)
        for seed, how, outcome, text in trials(source.stem, source, Path(folder), seeds):
            numbers[outcome] += 1
            failures += [[source.stem, seed, how, text[-1500:]]] if outcome == FAILED else []
    sys.stdout.write(json.dumps({"numbers": numbers, "failures": failures}))


if __name__ == "__main__":
    main(*sys.argv[1:])
