"""`pytest -m check --checks=FILE`: write what the acceptance checks measured, if all 20 ran and passed."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.checks.page import Measurement, missing, page

PROPERTY = "check"


class PageWriter:
    """Gathers what was measured and writes the page at the end of the run, or says why not."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.measured: list[Measurement] = []
        self.failed: list[str] = []
        self.outcome = ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed or report.skipped:
            self.failed.append(report.nodeid)
        if report.when == "call":
            self.measured += [value for name, value in report.user_properties if name == PROPERTY]

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.failed.append(report.nodeid)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        reasons = [f"{name} did not pass" for name in self.failed]
        reasons += [f"nothing was measured about pitfall {number}" for number in missing(self.measured)]
        if reasons:
            self.outcome = "\n".join([f"{self.path} is left as it was:", *reasons])
            session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED
        else:
            self.path.write_text(page(self.measured), encoding="utf-8")
            self.outcome = f"wrote {self.path}"

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        terminalreporter.write_line(self.outcome)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--checks", type=Path, metavar="FILE", help="write what the acceptance checks measured to FILE")


def pytest_configure(config: pytest.Config) -> None:
    if path := config.getoption("checks"):
        config.pluginmanager.register(PageWriter(path), "checks page")
