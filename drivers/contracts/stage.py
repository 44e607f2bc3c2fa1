"""What every stage keeps, simulated or not."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from drivers.errors import DeviceError, DeviceLimitError
from drivers.stage import Stage


class StageContract:
    """Subclass it, and give fixtures `stage` (not yet connected) and `now` (the seconds of its clock)."""

    @pytest.fixture
    def connected(self, stage: Stage) -> Iterator[Stage]:
        stage.connect()
        stage.home()
        yield stage
        stage.disconnect()

    def test_satisfies_the_protocol(self, stage: Stage) -> None:
        assert isinstance(stage, Stage)

    def test_refuses_to_work_before_it_is_connected(self, stage: Stage) -> None:
        acts = (stage.describe, stage.read, stage.home, lambda: stage.move({}), lambda: stage.move_duration({}))
        for act in acts:
            with pytest.raises(DeviceError, match="not connected"):
                act()

    def test_connects_disconnects_and_stops_at_any_time(self, stage: Stage) -> None:
        stage.disconnect()
        stage.stop()
        stage.connect()
        stage.connect()
        stage.stop()
        stage.disconnect()
        stage.disconnect()

    def test_axes_have_unit_vectors_and_ordered_limits(self, connected: Stage) -> None:
        for axis in connected.describe().axes:
            assert np.linalg.norm(axis.vector) == pytest.approx(1.0)
            assert axis.soft_limits.low < axis.soft_limits.high
            assert axis.tolerance > 0.0

    def test_reads_every_axis_it_describes(self, connected: Stage) -> None:
        assert list(connected.read()) == [axis.name for axis in connected.describe().axes]

    def test_arrives_within_its_tolerance(self, connected: Stage) -> None:
        for axis in connected.describe().axes:
            target = 0.3 * axis.soft_limits.low + 0.7 * axis.soft_limits.high
            read_back = connected.move({axis.name: target})
            assert read_back == connected.read()
            assert read_back[axis.name] == pytest.approx(target, abs=axis.tolerance)

    def test_leaves_the_axes_that_are_not_named(self, connected: Stage) -> None:
        first, *others = connected.describe().axes
        before = connected.read()
        after = connected.move({first.name: 0.25 * first.soft_limits.high})
        assert {axis.name: after[axis.name] for axis in others} == {axis.name: before[axis.name] for axis in others}

    def test_reaches_both_ends_of_every_axis(self, connected: Stage) -> None:
        for axis in connected.describe().axes:
            for end in (axis.soft_limits.low, axis.soft_limits.high):
                assert connected.move({axis.name: end})[axis.name] == pytest.approx(end, abs=axis.tolerance)

    def test_moves_nothing_if_one_target_is_out_of_limits(self, connected: Stage) -> None:
        first, *_, last = connected.describe().axes
        before = connected.read()
        with pytest.raises(DeviceLimitError, match=f"axis {last.name} is .* allowed is"):
            connected.move({first.name: 1.0, last.name: last.soft_limits.high + 1.0})
        assert connected.read() == before

    def test_names_its_axes_when_asked_for_another(self, connected: Stage) -> None:
        with pytest.raises(DeviceLimitError, match=connected.describe().axes[0].name):
            connected.move({"no such axis": 0.0})

    def test_predicts_how_long_a_move_takes(self, connected: Stage, now: Callable[[], float]) -> None:
        target = {axis.name: 0.2 * axis.soft_limits.high for axis in connected.describe().axes}
        predicted, began = connected.move_duration(target), now()
        connected.move(target)
        assert now() - began == pytest.approx(predicted, rel=0.05)
        assert connected.move_duration(target) == pytest.approx(0.0, abs=1.0)

    def test_goes_home_to_zero(self, connected: Stage) -> None:
        connected.move({axis.name: 0.2 * axis.soft_limits.high for axis in connected.describe().axes})
        connected.home()
        tolerance = {axis.name: axis.tolerance for axis in connected.describe().axes}
        assert all(abs(value) <= tolerance[name] for name, value in connected.read().items())

    def test_moves_again_after_a_stop(self, connected: Stage) -> None:
        connected.stop()
        axis = connected.describe().axes[0]
        assert connected.move({axis.name: 1.0})[axis.name] == pytest.approx(1.0, abs=axis.tolerance)
