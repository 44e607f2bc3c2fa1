"""How a test puts a row into the page of the faults."""

from __future__ import annotations

from dataclasses import astuple

import pytest

from tests.faults.page import Row


class FaultRecord:
    """Takes what became of the fault whose number the test's marker names."""

    def __init__(self, node: pytest.Item) -> None:
        marker = node.get_closest_marker("fault")
        assert marker is not None, f"{node.name} records a fault; mark it with its number"
        self._node, self.number = node, marker.args[0]

    def row(self, injected: str, happened: str, light_seconds: float | None = None, number: int | None = None) -> None:
        """Add a row; `light_seconds` after the fault, None where it was dark already."""
        file = self._node.path.relative_to(self._node.config.rootpath).as_posix()
        name = getattr(self._node, "originalname", self._node.name)
        light = "-" if light_seconds is None else f"{light_seconds:.2f}"
        row = Row(number or self.number, injected, happened, light, file, name)
        # As plain values: they may come from another process.
        self._node.user_properties.append(("fault", astuple(row)))


@pytest.fixture
def fault_record(request: pytest.FixtureRequest) -> FaultRecord:
    return FaultRecord(request.node)
