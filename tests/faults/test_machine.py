"""Any sequence of pauses, aborts, faults, kills and resumes ends with the frames of an uninterrupted capture."""

from __future__ import annotations

import shutil
import signal
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from drivers.errors import CancelledError, DeviceError
from drivers.simulated.faults import Fault
from instrument.session.session import Session
from protocols.capture.engine import Control, Progress, capture, resume
from tests.campaigns.small_rig import ended, processes
from tests.faults import bench
from tests.faults.bench import FaultyBench
from tests.verifying import verify_session

SPOILT = st.one_of(
    st.builds(
        Fault,
        st.just("camera"),
        st.sampled_from(["lost", "no_answer", "error", "dropped_frame", "repeated_frame", "stale_frame", "torn_frame"]),
        st.just("trigger"),
        st.integers(0, 20),
        repeats=st.integers(0, 3),
        value=st.sampled_from([1, 2, 1e9]),
    ),
    st.builds(Fault, st.just("stage"), st.sampled_from(["stall", "alarm", "slip"]), st.just("move"), st.integers(0, 4)),
    st.builds(Fault, st.just("light"), st.sampled_from(["stays_dark", "error"]), st.just("on"), st.integers(0, 3)),
    st.builds(Fault, st.just("light"), st.just("stays_on"), st.just("off"), st.integers(0, 8)),
)


class InterruptedCapture(RuleBasedStateMachine):
    """A session that goes through anything; `expected` is set by the test."""

    expected: dict[str, object]

    @initialize()
    def begin(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="halfangle-machine-"))
        self.path = self.folder / "s.h5"
        self.bench = FaultyBench()
        self.n_complete = 0

    @rule(moment=st.integers(0, 12))
    def pause(self, moment: int) -> None:
        control = Control()
        self._go_on(watch=_at(moment, control.pause), control=control)

    @rule(moment=st.integers(0, 12))
    def abort(self, moment: int) -> None:
        control = Control()
        self._go_on(watch=_at(moment, control.abort), control=control)

    @rule(moment=st.integers(0, 12))
    def interrupt(self, moment: int) -> None:
        def raise_it() -> None:
            raise KeyboardInterrupt

        self._go_on(watch=_at(moment, raise_it))

    @rule(fault=SPOILT)
    def spoil(self, fault: Fault) -> None:
        self._go_on(fault)

    @rule(number=st.integers(0, 70))
    def kill(self, number: int) -> None:
        target = bench.resume_and_die if self.path.exists() else bench.capture_and_die
        process = processes().Process(target=target, args=(str(self.path), number))
        process.start()
        # It may have been done before its turn came to die.
        assert ended(process) in (-signal.SIGKILL, 0)

    @rule()
    def finish(self) -> None:
        self._go_on()
        assert bench.content(self.path) == self.expected

    @invariant()
    def light_is_off(self) -> None:
        if hasattr(self, "bench") and self.bench.world is not None:
            assert self.bench.world.lamp.level == 0.0

    @invariant()
    def what_is_complete_is_whole_and_stays(self) -> None:
        if not hasattr(self, "path") or not self.path.exists():
            return
        assert list(verify_session(self.path)) == []
        assert bench.only_whole_poses(self.path)
        with Session(self.path) as session:
            complete = session.pose_complete
            frames = [session.frames(i).tobytes() for i in range(session.n_poses) if complete[i]]
        assert int(complete.sum()) >= self.n_complete
        self.n_complete = int(complete.sum())
        assert frames == self.expected["frames"][: self.n_complete]  # type: ignore[index]

    def teardown(self) -> None:
        if hasattr(self, "folder"):
            shutil.rmtree(self.folder)

    def _go_on(self, *faults: Fault, watch: Callable[[Progress], None] | None = None, **options: Any) -> None:
        self.bench = FaultyBench(faults)
        try:
            if self.path.exists():
                resume(self.path, watch, self.bench.devices, **options)
            else:
                capture(bench.rig_config(), bench.protocol_config(), self.path, watch, self.bench.devices, **options)
        except (DeviceError, CancelledError, KeyboardInterrupt):
            # All that may come of it; what is left is what the invariants are about.
            pass


def _at(moment: int, act: Callable[[], None]) -> Callable[[Progress], None]:
    reports: list[Progress] = []

    def watch(progress: Progress) -> None:
        reports.append(progress)
        if len(reports) == moment + 1:
            act()

    return watch


def run_machine(whole: dict[str, object], n_examples: int, n_steps: int) -> None:
    machine = type("Machine", (InterruptedCapture,), {"expected": whole}).TestCase
    machine.settings = settings(
        max_examples=n_examples,
        stateful_step_count=n_steps,
        deadline=None,
        derandomize=n_examples < 20,
        suppress_health_check=list(HealthCheck),
    )
    machine("runTest").runTest()


def test_any_short_story_of_interruptions_keeps_the_data(whole: dict[str, object]) -> None:
    run_machine(whole, n_examples=4, n_steps=5)


@pytest.mark.slow
def test_any_story_of_interruptions_keeps_the_data(whole: dict[str, object]) -> None:
    run_machine(whole, n_examples=40, n_steps=8)
