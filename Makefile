# `make demo` and `make test` set everything up by themselves; both are safe to repeat.
BIN := .venv/bin
# Where Qt's system libraries are missing, the window's tests are left out, with a word about it.
NO_GUI = $$($(BIN)/python -c 'import PySide6.QtWidgets' 2>/dev/null || \
	{ echo "tests: left out tests/gui, Qt's system libraries are missing (see make setup)" >&2; \
	echo "-p no:pytest-qt --ignore=tests/gui"; })

# A file of tests to each of two processes at a time: what tests of a file share is made once.
TWO = -n 2 --dist loadfile

.PHONY: help setup setup-run demo test checks faults soak screenshots map lint format constraints clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' Makefile

setup: ## make .venv ready for everything; does nothing when it is
	@scripts/setup.sh all

setup-run: ## the same for the commands alone: no window, no drivers' libraries, no Mitsuba, no tests
	@scripts/setup.sh run

demo: setup-run ## simulated rig to scored report, into demo/
	$(BIN)/halfangle demo -o demo --force

test: export QT_QPA_PLATFORM = offscreen
test: setup ## the test suite without the longer campaigns
	$(BIN)/pytest -q $(TWO) -m "not slow" $(NO_GUI)

checks: setup ## the acceptance checks; writes docs/checks.md when all pass
	$(BIN)/pytest -q -m check --checks=docs/checks.md $(NO_GUI)

faults: setup ## every fault that a capture must survive; writes docs/faults.md when all have passed
	$(BIN)/pytest -q -m fault --faults=docs/faults.md $(NO_GUI)

soak: export QT_QPA_PLATFORM = offscreen
soak: setup ## the longer campaigns
	@# Exit code 5: no such test is collected, which is no failure here.
	$(BIN)/pytest -q $(TWO) -m "slow and not alone" $(NO_GUI) || [ $$? -eq 5 ]
	$(BIN)/pytest -q -m alone $(NO_GUI) || [ $$? -eq 5 ]

screenshots: setup ## pictures of every tab of the console, light and dark, into docs/images/console
	PYTHONPATH=. $(BIN)/python scripts/screenshots.py

map: setup ## the map of the house in CONTRIBUTING.md, from the real imports
	$(BIN)/python scripts/house_map.py

lint: setup ## ruff, mypy, the import contracts, and no machine's name in the files
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	scripts/check_tracked_files.sh

format: setup ## let ruff put the files in order
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

PIN = CUSTOM_COMPILE_COMMAND="make constraints" $(BIN)/pip-compile --quiet --upgrade --generate-hashes \
	--no-emit-index-url --no-emit-trusted-host --no-emit-find-links --strip-extras --no-annotate

constraints: setup ## pin every dependency with its hashes, from pyproject.toml; needs what GenICam cameras need
	$(PIN) --extra dev --extra gui --build-deps-for editable --allow-unsafe --output-file constraints.txt pyproject.toml
	@# Of the same versions: what the commands themselves need, for those who do not work on the program.
	$(PIN) --constraint constraints.txt --build-deps-for editable --output-file constraints-run.txt pyproject.toml
	@# Built without Cairo, which draws, and which no camera needs.
	echo 'PyGObject<3.51' | $(PIN) --unsafe-package pycairo --output-file constraints-genicam.txt -
	sed -i -e 's/^pygobject==[^ ]*/& --config-settings=setup-args=-Dpycairo=disabled/' -e '/^# WARNING/,$$d' \
		constraints-genicam.txt
	printf '%s\n' meson meson-python ninja | \
		$(PIN) --constraint constraints.txt --output-file constraints-genicam-build.txt -

clean: ## remove caches, builds and the demo; keeps .venv
	rm -rf demo build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	find analysis benchmarks cli drivers gui instrument protocols tests -name __pycache__ -type d -prune -exec rm -rf {} +
