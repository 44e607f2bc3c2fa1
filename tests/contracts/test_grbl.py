import time
from collections.abc import Callable, Iterator

import pytest

from drivers.grbl.stage import GrblStage
from drivers.stage import Stage
from tests.contracts.stage import StageContract
from tests.drivers.grbl_double import GrblDouble
from tests.drivers.grbl_stages import settings_of


class TestGrblStage(StageContract):
    @pytest.fixture
    def stage(self, request: pytest.FixtureRequest) -> Iterator[Stage]:
        # Who looks at the clock gets a controller that lives by it; the others need not wait.
        with GrblDouble(pace=1.0 if "now" in request.fixturenames else 50.0) as double:
            yield GrblStage(settings_of(double))

    @pytest.fixture
    def now(self) -> Callable[[], float]:
        return time.monotonic
