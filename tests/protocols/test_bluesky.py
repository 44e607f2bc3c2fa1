"""The rig under a facility's orchestrator, and a session as its documents."""

import json
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from bluesky import RunEngine, plan_stubs, preprocessors, protocols
from bluesky.utils import RunEngineInterrupted
from event_model import DocumentNames, DocumentRouter, schema_validators

from drivers.errors import DeviceLimitError
from drivers.registry import open_devices
from drivers.simulated.faults import Fault
from instrument.rig.rig import Rig
from instrument.session.session import Session
from instrument.session_tools.documents import as_line, documents
from protocols.acquisition.bracket import Bracket
from protocols.bluesky import FacilityBracket, facility_axes
from tests.faults import bench
from tests.faults.bench import FaultyBench

POSES = [(10.0, 0.0), (20.0, 40.0), (25.0, 80.0), (30.0, 120.0)]
BRACKET = Bracket((0.002, 0.01), 0, (64.0, 64.0))


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig.open(bench.rig_config(), open_devices) as rig:
        yield rig


@pytest.fixture
def engine() -> RunEngine:
    return RunEngine({}, call_returns_result=False)


def sweep(rig: Rig, detector: FacilityBracket) -> Any:
    axes = facility_axes(rig)

    @preprocessors.stage_decorator([detector])
    @preprocessors.run_decorator()
    def poses() -> Any:
        for tilt, turn in POSES:
            yield from plan_stubs.checkpoint()
            yield from plan_stubs.mv(axes["tilt"], tilt, axes["turn"], turn)
            yield from plan_stubs.trigger_and_read([detector, *axes.values()])

    return poses()


def test_the_devices_have_the_shape_that_bluesky_asks_for(rig: Rig) -> None:
    detector, axes = FacilityBracket(rig, BRACKET), facility_axes(rig)
    for axis in axes.values():
        kinds = (protocols.Readable, protocols.Movable, protocols.Locatable, protocols.Checkable, protocols.Stoppable)
        assert all(isinstance(axis, kind) for kind in (*kinds, protocols.Configurable, protocols.HasHints))
    kinds = (protocols.Readable, protocols.Triggerable, protocols.Stageable, protocols.Pausable, protocols.Configurable)
    assert all(isinstance(detector, kind) for kind in kinds)


def test_a_sweep_under_the_run_engine_gives_valid_documents_with_every_frame_lit(rig: Rig, engine: RunEngine) -> None:
    gathered: list[tuple[str, dict[str, Any]]] = []
    engine(sweep(rig, FacilityBracket(rig, BRACKET)), lambda name, document: gathered.append((name, document)))
    events = [document for name, document in gathered if name == "event"]
    assert [(event["data"]["tilt"], event["data"]["turn"]) for event in events] == POSES
    assert all((event["data"]["bracket_mean"] > 66.0).all() for event in events)
    assert not rig.light.read().lit
    for name, document in gathered:
        if name != "event":
            schema_validators[DocumentNames[name]].validate(document)


def test_a_run_that_is_paused_and_resumed_takes_every_frame_in_the_light(rig: Rig, engine: RunEngine) -> None:
    events: list[dict[str, Any]] = []
    dark_while_paused: list[bool] = []

    def watch(name: str, document: dict[str, Any]) -> None:
        if name == "event":
            events.append(document)
            if len(events) in (1, 3):
                # Not from here: the engine waits for its own callbacks.
                Thread(target=engine.request_pause, args=(False,)).start()

    def run() -> None:
        try:
            engine(sweep(rig, FacilityBracket(rig, BRACKET)), watch)
        except RunEngineInterrupted:
            go_on()

    def go_on() -> None:
        dark_while_paused.append(not rig.light.read().lit)
        try:
            engine.resume()
        except RunEngineInterrupted:
            go_on()

    run()
    assert dark_while_paused == [True, True]
    assert {(event["data"]["tilt"], event["data"]["turn"]) for event in events} == set(POSES)
    assert all((event["data"]["bracket_mean"] > 66.0).all() for event in events)
    assert not rig.light.read().lit


def test_a_target_beyond_the_limits_is_refused_before_anything_moves(rig: Rig) -> None:
    axis = facility_axes(rig)["tilt"]
    with pytest.raises(DeviceLimitError, match="target of axis tilt is 80 deg"):
        axis.check_value(80.0)
    with pytest.raises(DeviceLimitError):
        axis.set(80.0)
    assert axis.locate() == {"setpoint": 0.0, "readback": 0.0}


def test_a_status_ends_with_the_error_of_its_action() -> None:
    faulty = FaultyBench((Fault("camera", "error", "trigger"),))
    with Rig.open(bench.rig_config(), faulty.devices) as rig:
        status, seen = FacilityBracket(rig, BRACKET).trigger(), list[bool]()
        assert "refused trigger" in str(status.exception(timeout=10.0))
        assert status.done
        assert not status.success
        status.add_callback(lambda status: seen.append(status.success))
        assert seen == [False]
        assert not rig.light.read().lit


def test_the_documents_of_a_session_are_valid_and_say_where_its_frames_lie(tmp_path: Path) -> None:
    path = bench.run(tmp_path / "s.h5", Fault("camera", "error", "trigger", 14, repeats=0)).path
    with Session(path) as session:
        made = list(documents(session))
        assert made == list(documents(session))
        n_complete = int(session.pose_complete.sum())
    router = DocumentRouter()
    for name, document in made:
        schema_validators[DocumentNames[name]].validate(document)
        router(name, document)
        assert json.loads(as_line(name, document))[0] == name
    names = [name for name, _ in made]
    assert names.count("event") == names.count("stream_datum") == n_complete == 2
    resource = next(document for name, document in made if name == "stream_resource")
    assert resource["uri"] == path.as_uri()
    stop = made[-1][1]
    assert (stop["exit_status"], stop["num_events"]) == ("abort", {"primary": 2})


def test_the_documents_name_the_same_frames_as_the_session(tmp_path: Path) -> None:
    path = bench.run(tmp_path / "s.h5").path
    with Session(path) as session:
        events = [document["data"] for name, document in documents(session) if name == "event"]
        assert [event["pose_digest"] for event in events] == session.pose_digests
        np.testing.assert_array_equal([event["turn"] for event in events], session.axis_values["turn"])
