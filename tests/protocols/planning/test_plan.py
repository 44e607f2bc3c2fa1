import pytest
from hypothesis import given
from hypothesis import strategies as st

from instrument.config.loading import ProtocolConfig
from instrument.files.validation import InvalidInputError
from protocols.planning.estimate import estimate
from protocols.planning.plan import Plan
from tests.protocols.fakes import FakeBench, protocol_config, rig_config

TIMES = {"exposure_times_s": (0.01, 0.1), "darks": 3}


def plan_of(**tables: object) -> Plan:
    return Plan.from_protocol(ProtocolConfig.model_validate({"name": "p", "bracket": TIMES, **tables}))


def test_poses_come_in_the_order_of_the_rings_and_then_the_single_poses() -> None:
    plan = plan_of(
        rings=({"tilt_deg": 20.0, "count": 2, "start_deg": 200.0}, {"tilt_deg": 0.0, "count": 1}),
        poses=({"axes": {"turn": 7.0, "tilt": -3.0}},),
    )
    assert plan.axes == ("tilt", "turn")
    assert plan.positions == ((20.0, 200.0), (20.0, 20.0), (0.0, 0.0), (-3.0, 7.0))
    assert plan.target(3) == {"tilt": -3.0, "turn": 7.0}
    assert plan.targets["turn"] == (200.0, 20.0, 0.0, 7.0)


def test_single_poses_may_use_any_axes() -> None:
    plan = plan_of(poses=({"axes": {"x": 1.5}}, {"axes": {"x": 2.5}}))
    assert plan.targets == {"x": (1.5, 2.5)}


def test_the_digest_of_a_plan_is_the_same_on_every_machine_and_day() -> None:
    plan = plan_of(rings=({"tilt_deg": 10.0, "count": 3},))
    assert plan.json == (
        '{"axes":["tilt","turn"],"darks":3,"exposure_times_s":[0.01,0.1],'
        '"positions":[[10.0,0.0],[10.0,120.0],[10.0,240.0]],"version":"1.0"}'
    )
    assert plan.sha256 == "1da59813a69d66d3e895718df6d5c26a1b7c42f8c2aad0ae96a52cbc4c87b2b1"


@pytest.mark.parametrize(
    "other",
    [
        {"rings": ({"tilt_deg": 10.0, "count": 3, "start_deg": 1.0},)},
        {"rings": ({"tilt_deg": 10.0, "count": 3},), "bracket": {**TIMES, "darks": 2}},
        {"rings": ({"tilt_deg": 10.0, "count": 3},), "bracket": {**TIMES, "exposure_times_s": (0.01, 0.2)}},
    ],
)
def test_any_change_of_a_plan_changes_its_digest(other: dict[str, object]) -> None:
    assert plan_of(**other).sha256 != plan_of(rings=({"tilt_deg": 10.0, "count": 3},)).sha256


@given(
    positions=st.lists(st.tuples(st.floats(-90, 90), st.floats(0, 360)), min_size=1).map(tuple),
    times=st.lists(st.floats(1e-6, 100), min_size=1).map(tuple),
    darks=st.integers(0, 100),
)
def test_a_plan_reads_back_from_its_json(
    positions: tuple[tuple[float, ...], ...], times: tuple[float, ...], darks: int
) -> None:
    plan = Plan(("tilt", "turn"), positions, times, darks)
    assert Plan.from_json(plan.json) == plan


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"axes": 3}', "null", '{"axes":["x"],"darks":1}'])
def test_a_text_that_is_no_plan_is_refused(text: str) -> None:
    with pytest.raises(InvalidInputError, match="is not the canonical text of a plan"):
        Plan.from_json(text)


def test_an_estimate_counts_poses_frames_bytes_and_seconds_without_a_motion() -> None:
    bench = FakeBench()
    outlook = estimate(rig_config(), protocol_config(count=4), bench.devices)
    assert (outlook.n_poses, outlook.n_frames, outlook.n_darks) == (4, 8, 4)
    assert outlook.light_on_seconds == pytest.approx(0.44)
    # Moves of the fake stage: 10 deg, then three of 90 deg at 10 deg/s. A pose takes two frames and a short one that
    # looks whether it is dark again; each of 16 frames costs 20 ms besides its exposure.
    assert outlook.seconds == pytest.approx(1 + 27 + 0.44 + 4 * 0.01 + 0.22 + 0.32)
    assert outlook.bytes > 8 * 16 * 24 * 2
    assert not {"stage.home", "stage.move", "light.on"} & set(bench.calls)
    assert "poses     4" in outlook.as_text()
    assert "about 29 s" in outlook.as_text()


def test_a_way_longer_than_the_stage_reaches_from_zero_is_estimated_all_the_same() -> None:
    protocol = ProtocolConfig.model_validate(
        {
            "name": "far",
            "bracket": TIMES,
            "poses": ({"axes": {"tilt": -50.0}}, {"axes": {"tilt": 50.0}}),
        }
    )
    assert estimate(rig_config(), protocol, FakeBench().devices).seconds > 15
