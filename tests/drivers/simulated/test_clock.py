from threading import Event

import pytest

from drivers.clock import Clock, RealClock, sleep_unless
from drivers.simulated.clock import VirtualClock


@pytest.mark.parametrize("clock", [VirtualClock(), RealClock()])
def test_time_passes_while_a_clock_sleeps(clock: Clock):
    before = clock.now()
    clock.sleep(0.01)
    assert clock.now() - before >= 0.0099
    assert isinstance(clock, Clock)


@pytest.mark.parametrize("seconds", [-1.0, float("nan")])
def test_a_virtual_clock_does_not_run_backwards(seconds: float):
    with pytest.raises(ValueError, match="0 s or more"):
        VirtualClock().sleep(seconds)


@pytest.mark.parametrize("start", [0.0, 0.1, 12345.678])
def test_napping_takes_exactly_as_long_as_asked(start: float):
    clock = VirtualClock(start)
    assert sleep_unless(Event(), clock, 3.3)
    assert clock.now() == pytest.approx(start + 3.3, abs=1e-9)


def test_a_set_event_ends_the_wait_at_once():
    clock, stopped = VirtualClock(), Event()
    stopped.set()
    assert not sleep_unless(stopped, clock, 3.3)
    assert clock.now() == 0.0
