"""What the acceptance checks share: the record of what they measure, and one small simulated session."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple
from pathlib import Path

import pytest

from tests.checks.page import Measurement, shown
from tests.checks.simulated import Simulated, simulate
from tests.checks.worlds import NeutralWorld


class Record:
    """Takes what a check measures; fails where it is not allowed."""

    def __init__(self, node: pytest.Item) -> None:
        marker = node.get_closest_marker("check")
        assert marker is not None, f"{node.name} records and is no check; mark it with its number"
        self._node, self._number = node, marker.args[0]

    def at_most(self, what: str, value: float, limit: float, unit: str = "") -> None:
        """Record a value that must not exceed `limit`."""
        self._add(what, value, limit, "≤", unit)
        assert value <= limit, f"{what}: {value} {unit}; allowed is {limit} at most"

    def at_least(self, what: str, value: float, limit: float, unit: str = "") -> None:
        """Record a value that must reach `limit`."""
        self._add(what, value, limit, "≥", unit)
        assert value >= limit, f"{what}: {value} {unit}; allowed is {limit} at least"

    def holds(self, what: str, so: bool) -> None:
        """Record something that must be so."""
        self._write(what, "yes" if so else "no", "yes")
        assert so, what

    def _add(self, what: str, value: float, limit: float, sign: str, unit: str) -> None:
        self._write(what, f"{shown(float(value), limit)} {unit}".rstrip(), f"{sign} {limit:g} {unit}".rstrip())

    def _write(self, what: str, value: str, limit: str) -> None:
        file = self._node.path.relative_to(self._node.config.rootpath).as_posix()
        name = getattr(self._node, "originalname", self._node.name)
        # As plain values: they may come from another process.
        measured = Measurement(self._number, what, value, limit, file, name)
        self._node.user_properties.append(("check", astuple(measured)))


@pytest.fixture
def record(request: pytest.FixtureRequest) -> Record:
    return Record(request.node)


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulated]:
    """13 poses of the simulated relief, calibrated, registered and reconstructed."""
    folder: Path = tmp_path_factory.mktemp("checks")
    with simulate(folder) as made:
        yield made


@pytest.fixture(scope="session")
def neutral() -> NeutralWorld:
    """The relief in greys, seen without noise."""
    return NeutralWorld.build()
