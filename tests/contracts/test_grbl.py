from collections.abc import Callable, Iterator

import pytest

from drivers.contracts.stage import StageContract
from drivers.grbl.stage import GrblStage
from drivers.stage import Stage
from tests.drivers.grbl.grbl_double import GrblDouble
from tests.drivers.grbl.grbl_stages import settings_of


class TestGrblStage(StageContract):
    @pytest.fixture
    def double(self, request: pytest.FixtureRequest) -> Iterator[GrblDouble]:
        # Who looks at the clock gets a machine that lives by it, and takes its time; the others need not wait.
        pace = 1.0 if "now" in request.fixturenames else 50.0
        with GrblDouble(pace, settings={110: 1200.0, 111: 1200.0}) as double:
            yield double

    @pytest.fixture
    def stage(self, double: GrblDouble) -> Stage:
        return GrblStage(settings_of(double), double.clock)

    @pytest.fixture
    def now(self, double: GrblDouble) -> Callable[[], float]:
        return lambda: double.time
