"""docs/faults.md shows all 26 faults, and the tests that it names are there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from tests.faults.page import FAULTS, Row, missing, page

HERE = Path(__file__).parent
PAGE = (HERE.parents[1] / "docs" / "faults.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (\d*) \| (.*?) \|.*\[(test_\w+)\]\(\.\./(\S+)\) \|$", PAGE, re.MULTILINE)


def tests_of_faults() -> set[tuple[str, str]]:
    """Return the names of the tests that put a row into the page, each with its file."""
    found = set()
    for path in sorted(HERE.glob("test_*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and "fault_record.row" in ast.unparse(node):
                found.add((node.name, f"tests/faults/{path.name}"))
    return found


def test_the_page_lists_all_faults_in_order() -> None:
    listed = [(int(number), name) for number, name, *_ in ROWS if number]
    assert listed == list(FAULTS.items())
    assert len(FAULTS) == 26


def test_the_page_names_every_test_that_shows_a_fault_and_no_other() -> None:
    assert {(test, file) for *_, test, file in ROWS} == tests_of_faults()


def test_a_fault_that_no_test_showed_is_missing() -> None:
    rows = [Row(number, "pulled", "goes on", "-", "tests/a.py", "test_a") for number in FAULTS if number != 7]
    assert missing(rows) == [7]
    assert page(rows).count("\n| ") == 26
