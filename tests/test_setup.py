"""The two sets that scripts/setup.sh installs: what the commands need, and everything."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[1]
OURS = {"analysis", "benchmarks", "cli", "drivers", "gui", "instrument", "protocols"}
# What belongs to an extra, and says so where it is missing: the window, the drivers' test bench, Mitsuba's process.
OF_EXTRAS = (
    "gui/",
    "drivers/contracts/",
    "benchmarks/reproduction/mitsuba_scenes/child.py",
    "benchmarks/speed/console.py",
    "benchmarks/speed/watchdog.py",
)


def pinned(name: str) -> dict[str, tuple[str, ...]]:
    """Return the version and the hashes of each package of a file of constraints."""
    text = (ROOT / name).read_text(encoding="utf-8")
    entries = re.findall(r"^([a-z0-9-]+)==([^ ]+) ((?:\\\n +--hash=\S+ ?)+)", text, re.MULTILINE)
    return {package: (version, *re.findall(r"--hash=(\S+)", hashes)) for package, version, hashes in entries}


def imported() -> Iterator[tuple[str, str]]:
    """Yield (package of somebody else's, file) of each import statement that needs no extra."""
    for package in sorted(OURS):
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if name.startswith(OF_EXTRAS):
                continue
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                for top in {module.split(".")[0] for module in modules} - OURS - sys.stdlib_module_names:
                    yield top, name


def test_what_runs_has_the_versions_that_are_tested():
    run, everything = pinned("constraints-run.txt"), pinned("constraints.txt")
    assert {"numpy", "hatchling"} <= set(run)
    assert "pytest" in set(everything) - set(run)
    assert run == {name: everything[name] for name in run}


def test_what_a_plain_command_imports_is_in_the_smaller_set():
    run, distributions = pinned("constraints-run.txt"), packages_distributions()
    needs = set(imported())
    assert {"numpy", "click"} <= {package for package, _ in needs}
    missing = [
        (package, name)
        for package, name in sorted(needs)
        if not any(re.sub("[_.]", "-", d).lower() in run for d in distributions.get(package, [package]))
    ]
    assert missing == []


def test_a_set_that_is_not_there_is_refused_by_name():
    asked = subprocess.run([ROOT / "scripts/setup.sh", "gui"], capture_output=True, text=True, check=False)
    assert asked.returncode == 1
    assert asked.stderr == "setup: there is no set 'gui'; there are run (what the commands need) and all\n"
