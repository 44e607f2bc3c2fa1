"""Pages that tests write of what they measured: `pytest -m check --checks=FILE`, `pytest -m fault --faults=FILE`.

A page is written if all that it is about was measured and passed; else it is left as it was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.checks import page as checks_page
from tests.checks.page import Measurement
from tests.faults import page as faults_page
from tests.faults.page import Row


class PageWriter:
    """Gathers what was measured and writes the page at the end of the run, or says why not."""

    def __init__(
        self,
        path: Path,
        kind: str,
        row: Callable[..., Any],
        missing: Callable[[Sequence[Any]], list[int]],
        page: Callable[[Sequence[Any]], str],
    ) -> None:
        self.path, self.kind, self._row, self._missing, self._page = path, kind, row, missing, page
        self.measured: list[Any] = []
        self.failed: list[str] = []
        self.outcome = ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed or report.skipped:
            self.failed.append(report.nodeid)
        if report.when == "call":
            self.measured += [self._row(*value) for name, value in report.user_properties if name == self.kind]

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.failed.append(report.nodeid)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        reasons = [f"{name} did not pass" for name in self.failed]
        reasons += [f"nothing was measured about {self.kind} {number}" for number in self._missing(self.measured)]
        if reasons:
            self.outcome = "\n".join([f"{self.path} is left as it was:", *reasons])
            session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED
        else:
            self.path.write_text(self._page(self.measured), encoding="utf-8")
            self.outcome = f"wrote {self.path}"

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        terminalreporter.write_line(self.outcome)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--checks", type=Path, metavar="FILE", help="write what the acceptance checks measured to FILE")
    parser.addoption("--faults", type=Path, metavar="FILE", help="write what became of each fault to FILE")


def pytest_configure(config: pytest.Config) -> None:
    # Of several processes only the one that hears of all tests writes.
    if hasattr(config, "workerinput"):
        return
    kinds = (("checks", "check", Measurement, checks_page), ("faults", "fault", Row, faults_page))
    for option, kind, row, about in kinds:
        if path := config.getoption(option):
            config.pluginmanager.register(PageWriter(path, kind, row, about.missing, about.page), f"{option} page")
