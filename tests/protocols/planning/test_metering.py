from contextlib import suppress
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import UnsafeError
from drivers.registry import open_devices
from instrument.config.loading import ProtocolConfig
from instrument.config.messages import validate
from instrument.rig.rig import Rig
from instrument.session.session import Session
from protocols.capture.engine import Finish, capture
from protocols.planning.metering import SceneRange, fewest_exposures, largest_noise, scout_poses
from protocols.planning.prepare import prepare
from tests.faults.bench import FaultyBench, rig_config
from tests.protocols.fakes import FakeBench
from tests.protocols.fakes import rig_config as fake_rig_config

WELL, READ_NOISE = 8000.0, 3.0


def protocol(**auto: float) -> ProtocolConfig:
    bracket = {"auto": auto, "darks": 0}
    return validate(ProtocolConfig, {"name": "p", "bracket": bracket, "rings": [{"tilt_deg": 20.0, "count": 3}]})


def noise_of(times: tuple[float, ...], scene: SceneRange) -> float:
    """The largest noise over many radiances, by the definition and not by its edges."""
    radiances = np.geomspace(scene.darkest, scene.brightest, 2000)
    information = np.zeros_like(radiances)
    for time in times:
        e = radiances * time
        information += np.where(e <= WELL * (1.0 + 1e-6), e**2 / (e + READ_NOISE**2), 0.0)
    return float(1.0 / np.sqrt(information.min())) if information.min() > 0 else np.inf


@given(
    darkest=st.floats(1e2, 1e5),
    ratio=st.floats(1.0, 1e4),
    bound=st.floats(0.015, 0.1),
)
@settings(max_examples=60, deadline=None)
def test_the_bracket_keeps_the_bound_over_the_whole_range(darkest: float, ratio: float, bound: float) -> None:
    scene = SceneRange(darkest, darkest * ratio)
    times = fewest_exposures(scene, bound, WELL, READ_NOISE, (1e-9, 1e9))
    assert noise_of(times, scene) <= bound * 1.001
    assert largest_noise(times, scene, WELL, READ_NOISE) == pytest.approx(noise_of(times, scene), rel=0.02)
    assert list(times) == sorted(times)


@pytest.mark.parametrize(("ratio", "bound"), [(30.0, 0.02), (100.0, 0.05), (100.0, 0.03)])
def test_no_bracket_of_fewer_exposures_keeps_the_bound(ratio: float, bound: float) -> None:
    scene = SceneRange(1e3, 1e3 * ratio)
    times = fewest_exposures(scene, bound, WELL, READ_NOISE, (1e-9, 1e9))
    assert 2 <= len(times) <= 4
    # The shortest must hold the brightest, and none can be shorter to any use than that.
    candidates = np.geomspace(0.5 * times[0], 2.0 * times[-1], 16)
    assert all(noise_of(other, scene) > bound for other in combinations(candidates, len(times) - 1))


def test_scouts_are_spread_over_the_plan() -> None:
    assert scout_poses(1) == [0]
    assert scout_poses(3) == [0, 1, 2]
    assert scout_poses(65)[0] == 0
    assert scout_poses(65)[-1] == 64
    assert len(scout_poses(65)) == 8


def test_a_metered_bracket_holds_what_it_promises_on_the_simulated_rig(tmp_path: Path) -> None:
    outcome = capture(rig_config(), protocol(noise=0.03), tmp_path / "s.h5", devices=FaultyBench().devices)
    assert outcome.finish is Finish.COMPLETE
    with Session(tmp_path / "s.h5") as session:
        # Locked for the session and recorded: the plan's times are the metered ones.
        assert 1 < len(session.exposure_times) <= 8
        assert any('"event": "metered"' in event for event in session.events)
        camera, times = session.camera, session.exposure_times
        assert session.saturated_fraction[:, 0].max() < 1e-3
        for i_pose in range(session.n_poses):
            rates = session.frames(i_pose).astype(float) - camera.black_level
            usable = session.frames(i_pose) < 0.95 * camera.saturation_value
            e = np.where(usable, np.maximum(rates, 0.0) * camera.conversion_gain, 0.0)
            information = (e**2 / (e + camera.read_noise**2)).sum(axis=0)
            noise = 1.0 / np.sqrt(np.maximum(information, 1e-9))
            # One percent may be darker; photons and the light's jitter from pose to pose take their share.
            assert np.mean(noise > 0.033) < 0.03
    assert list(times) == sorted(times)


def test_a_bound_that_cannot_be_kept_is_refused_with_what_would_help(tmp_path: Path) -> None:
    wanted = protocol(noise=0.001, most_exposures=3)
    with pytest.raises(UnsafeError, match=r"asks for a noise of 0.001 .* Allow more noise, more or other exposures"):
        capture(rig_config(), wanted, tmp_path / "s.h5", devices=FaultyBench().devices)
    assert not (tmp_path / "s.h5").exists()


def test_an_estimate_of_a_metered_bracket_lights_nothing() -> None:
    with Rig.connected(rig_config(), open_devices) as rig:
        prepared = prepare(rig, protocol(noise=0.02, most_exposures=4))
        assert len(prepared.plan.exposure_times) == 4
        assert not rig.light.read().lit


def test_scout_frames_are_taken_after_the_stage_has_found_its_zero() -> None:
    bench = FakeBench()
    with Rig.connected(fake_rig_config(), bench.devices) as rig, suppress(UnsafeError):
        prepare(rig, protocol(noise=0.05, most_exposures=4)).metered(rig)
    moves = [call for call in bench.calls if call in {"stage.home", "stage.move"}]
    assert moves[0] == "stage.home"
    assert "stage.move" in moves
