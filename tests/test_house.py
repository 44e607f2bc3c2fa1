"""The house rules that a tool or a look across the whole repository can check."""

import ast
import importlib
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("analysis", "benchmarks", "cli", "drivers", "gui", "instrument", "protocols")
CITATION = re.compile(r"\[([a-z]+\d{4}[a-z]?)(?:,[^\]]*)?\]")

PRINT_MODULES_AFTER_HELP = """
import json, sys
from cli.main import main
try:
    main(["--help"])
finally:
    print(json.dumps(sorted(sys.modules)), file=sys.stderr)
"""


def citations() -> Iterator[tuple[str, str]]:
    """Yield (key, file) of each work that a docstring cites."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                    for key in CITATION.findall(ast.get_docstring(node) or ""):
                        yield key, str(path.relative_to(ROOT))


def bibliography() -> list[str]:
    return re.findall(r"^@\w+\{(\w+),", (ROOT / "docs/bibliography.bib").read_text(encoding="utf-8"), re.MULTILINE)


def test_every_work_that_a_docstring_cites_is_in_the_bibliography():
    cited = set(citations())
    assert cited, "no citation found at all: has the pattern gone stale?"
    assert sorted((key, path) for key, path in cited if key not in bibliography()) == []


def test_no_work_stands_twice_in_the_bibliography():
    keys = bibliography()
    assert sorted(keys) == sorted(set(keys))


def test_works_that_the_pages_cite_are_in_the_bibliography():
    pages = (ROOT / "docs").glob("*.md")
    cited = {key for page in pages for key in CITATION.findall(page.read_text(encoding="utf-8"))}
    assert cited <= set(bibliography())


@pytest.mark.parametrize("name", PACKAGES)
def test_no_other_wheel_stands_in_for_a_package_of_ours(name: str):
    # The names are plain, so another wheel that ships, say, `drivers/` could come first on the path.
    package = importlib.import_module(name)
    assert [Path(place).resolve() for place in package.__path__] == [ROOT.resolve() / name]


def test_help_imports_neither_numpy_nor_qt():
    helped = subprocess.run(
        [sys.executable, "-c", PRINT_MODULES_AFTER_HELP], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "console" in helped.stdout
    packages = {module.split(".")[0] for module in json.loads(helped.stderr)}
    assert packages.isdisjoint({"numpy", "PySide6", "h5py", "scipy", "numba", "cv2", "pydantic"})


def test_imports_flow_one_way():
    command = Path(sys.executable).with_name("lint-imports")
    linted = subprocess.run([command, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert linted.returncode == 0, linted.stdout


def test_the_map_of_the_house_is_that_of_the_imports():
    checked = subprocess.run(
        [sys.executable, "scripts/house_map.py", "--check"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stderr


def folders_of_modules() -> Iterator[tuple[str, int]]:
    for package in PACKAGES:
        for folder in [ROOT / package, *(path for path in (ROOT / package).rglob("*") if path.is_dir())]:
            yield str(folder.relative_to(ROOT)), sum(path.name != "__init__.py" for path in folder.glob("*.py"))


def test_no_room_has_more_than_14_modules():
    assert [(name, n) for name, n in folders_of_modules() if n > 14] == []


def test_every_package_has_an_exhaustive_order_of_its_rooms():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    ordered = {name for contract in contracts if contract.get("exhaustive") for name in contract["containers"]}
    assert set(PACKAGES) - {"cli"} <= ordered
