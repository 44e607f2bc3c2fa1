"""docs/checks.md shows all pitfalls, and the tests that it names are there; the page is written whole or not at all."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from tests.checks.page import PITFALLS, Measurement, missing, page, shown

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "checks.md"
ROWS = re.findall(
    r"^\| (\d*) \| (.*?) \|.*\[(test_\w+)\]\(\.\./(\S+)\) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
)


def checks() -> set[tuple[str, str]]:
    """Return the names of the tests that are marked as checks, each with its file."""
    found = set()
    for path in sorted(HERE.glob("test_*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and any("mark.check" in ast.unparse(d) for d in node.decorator_list):
                found.add((node.name, f"tests/checks/{path.name}"))
    return found


def test_the_page_lists_all_pitfalls_in_order() -> None:
    listed = [(int(number), pitfall) for number, pitfall, *_ in ROWS if number]
    assert listed == list(PITFALLS.items())
    assert len(PITFALLS) == 20


def test_the_page_names_every_check_and_no_other_test() -> None:
    assert {(test, file) for *_, test, file in ROWS} == checks()


def test_a_pitfall_that_nothing_was_measured_about_is_missing() -> None:
    measured = [Measurement(n, "off", "1", "≤ 2", "tests/a.py", "test_a") for n in PITFALLS if n != 7]
    assert missing(measured) == [7]
    assert page(measured).count("\n| ") == 20


@pytest.mark.parametrize(("value", "text"), [(0.01234, "0.012"), (0.0, "0"), (1e-9, "< 0.0005"), (1234.5, "1200")])
def test_a_value_is_shown_by_two_digits_or_as_nothing_beside_its_limit(value: float, text: str) -> None:
    assert shown(value, 0.5) == text
