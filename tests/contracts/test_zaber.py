from collections.abc import Callable, Iterator

import pytest

from drivers.contracts.stage import StageContract
from drivers.stage import Stage
from drivers.zaber.stage import ZaberStage
from tests.drivers.zaber.zaber_double import ZaberDouble
from tests.drivers.zaber.zaber_stages import settings_of, skip_without_zaber

skip_without_zaber()


class TestZaberStage(StageContract):
    @pytest.fixture
    def double(self, request: pytest.FixtureRequest) -> Iterator[ZaberDouble]:
        # Who looks at the clock gets devices that live by it, and take their time; the others need not wait.
        with ZaberDouble(1.0 if "now" in request.fixturenames else 200.0) as double:
            yield double

    @pytest.fixture
    def stage(self, double: ZaberDouble) -> Stage:
        return ZaberStage(settings_of(double), double.clock)

    @pytest.fixture
    def now(self, double: ZaberDouble) -> Callable[[], float]:
        return lambda: double.time
