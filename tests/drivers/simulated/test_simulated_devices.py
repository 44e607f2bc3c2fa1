import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import DeviceError
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.clock import VirtualClock
from drivers.simulated.devices import open_simulated
from drivers.simulated.light import SimulatedLight
from drivers.simulated.stage import SimulatedStage
from drivers.simulated.world import World
from tests.drivers.rigs import small_rig

Devices = tuple[World, SimulatedCamera, SimulatedLight, SimulatedStage]


def ready(clock: Any = None, **simulation: Any) -> Devices:
    world, *devices = open_simulated(small_rig(**{"scene": "plane", "warm_up_drift": 0.0, **simulation}), clock)
    for device in devices:
        device.connect()
    return world, *devices


class InterruptedClock(VirtualClock):
    """At some time it does what somebody else does meanwhile."""

    def __init__(self) -> None:
        super().__init__()
        self._at: tuple[float, Callable[[], None]] | None = None

    def at(self, seconds: float, act: Callable[[], None]) -> None:
        self._at = (self.now() + seconds, act)

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        if self._at is not None and self.now() >= self._at[0]:
            (_, act), self._at = self._at, None
            act()


def photograph(devices: Devices, position: dict[str, float]) -> np.ndarray:
    _, camera, light, stage = devices
    stage.move(position)
    light.on(1.0, 60.0)
    return camera.trigger().counts


def test_the_same_seed_gives_the_same_frames():
    position = {"tilt": 10.0, "turn": 20.0}
    np.testing.assert_array_equal(photograph(ready(), position), photograph(ready(), position))


def test_another_seed_gives_other_frames():
    position = {"tilt": 10.0, "turn": 20.0}
    assert np.any(photograph(ready(), position) != photograph(ready(seed=6), position))


def test_a_resumed_capture_sees_what_an_uninterrupted_one_does():
    poses = [{"tilt": 10.0, "turn": 20.0}, {"tilt": 20.0, "turn": 40.0}, {"tilt": 30.0, "turn": 60.0}]
    uninterrupted = ready()
    frames = [photograph(uninterrupted, pose) for pose in poses]
    np.testing.assert_array_equal(photograph(ready(), poses[-1]), frames[-1])


def test_repeated_frames_differ_by_their_noise_alone():
    devices = ready()
    world, camera, *_ = devices
    first = photograph(devices, {"tilt": 0.0}).astype(float)
    difference = camera.trigger().counts - first
    assert np.any(difference != 0.0)
    variance = (first.mean() - world.sensor.black_level) / world.sensor.conversion_gain
    assert difference.var() == pytest.approx(2.0 * variance, rel=0.15)


def test_a_picture_is_rendered_once_for_all_exposures_of_a_pose(monkeypatch: pytest.MonkeyPatch):
    devices = ready()
    world, camera, *_ = devices
    rendered = []
    picture = world.picture
    monkeypatch.setattr(world, "picture", lambda: rendered.append(1) or picture())
    photograph(devices, {"tilt": 5.0})
    for exposure_time in (0.002, 0.05):
        camera.set_exposure_time(exposure_time)
        camera.trigger()
    assert len(rendered) == 1
    photograph(devices, {"tilt": 6.0})
    assert len(rendered) == 2


def test_counts_grow_in_step_with_the_exposure_time():
    devices = ready()
    world, camera, *_ = devices
    photograph(devices, {"tilt": 0.0})
    signal = []
    for exposure_time in (0.001, 0.002, 0.004):
        camera.set_exposure_time(exposure_time)
        signal.append(camera.trigger().counts.mean() - world.sensor.black_level)
    np.testing.assert_allclose(np.array(signal) / signal[0], [1.0, 2.0, 4.0], rtol=0.02)


def test_the_camera_sees_black_when_the_light_is_off():
    devices = ready()
    world, camera, light, _ = devices
    photograph(devices, {"tilt": 0.0})
    light.off()
    assert camera.trigger().counts.mean() == pytest.approx(world.sensor.black_level, abs=0.2)


def test_a_lease_that_ends_during_an_exposure_leaves_the_rest_dark():
    world, camera, light, _ = ready()
    camera.set_exposure_time(0.004)
    light.on(1.0, 1.0)
    whole = camera.trigger().counts.mean() - world.sensor.black_level
    light.on(1.0, 0.001)
    quarter = camera.trigger().counts.mean() - world.sensor.black_level
    assert quarter == pytest.approx(0.25 * whole, rel=0.05)
    assert not light.read().lit


def test_exposing_takes_the_exposure_time():
    world, camera, *_ = ready()
    camera.set_exposure_time(0.25)
    before = world.clock.now()
    camera.trigger()
    assert world.clock.now() - before == pytest.approx(0.25)


def test_the_power_settles_as_the_light_warms_up():
    world, _, light, _ = ready(warm_up_drift=0.02, warm_up_s=100.0)
    cold = light.on(1.0, 1000.0).monitor
    world.clock.sleep(50.0)
    lukewarm = light.read().monitor
    world.clock.sleep(50.0)
    assert cold == pytest.approx(1.02)
    assert cold > lukewarm > 1.0
    assert light.read().monitor == 1.0


def test_the_light_only_warms_up_while_it_shines():
    world, _, light, _ = ready(warm_up_drift=0.02, warm_up_s=100.0)
    light.on(1.0, 10.0)
    world.clock.sleep(500.0)
    assert world.lamp.lit_seconds == pytest.approx(10.0)
    light.off()
    assert world.lamp.lit_seconds == pytest.approx(10.0)


def test_the_power_differs_from_pose_to_pose_as_much_as_told():
    world, *_ = ready(power_jitter=0.05)
    powers = [world.light_power({"tilt": tilt, "turn": 0.0}) for tilt in np.linspace(-60.0, 60.0, 400)]
    assert np.std(powers) == pytest.approx(0.05, rel=0.15)
    assert world.light_power({"tilt": 1.0}) == world.light_power({"tilt": 1.0})


def test_the_axes_are_close_to_where_they_read():
    world, *_ = ready(axis_error_deg=0.02)
    errors = [world.true_angles({"tilt": t, "turn": 0.0})["tilt"] - t for t in np.linspace(-60.0, 60.0, 400)]
    assert np.std(errors) == pytest.approx(0.02, rel=0.15)


def test_a_move_can_be_stopped_on_its_way():
    clock = InterruptedClock()
    *_, stage = ready(clock)
    clock.at(0.3, stage.stop)
    with pytest.raises(DeviceError, match=r"the move to tilt 60 deg, turn 0 deg was stopped at tilt"):
        stage.move({"tilt": 60.0})
    assert 0.0 < stage.read()["tilt"] < 30.0


def test_an_exposure_can_be_stopped():
    clock = InterruptedClock()
    _, camera, _, _ = ready(clock)
    camera.set_exposure_time(5.0)
    began = clock.now()
    clock.at(0.2, camera.stop)
    with pytest.raises(DeviceError, match="exposure was stopped"):
        camera.trigger()
    assert clock.now() - began < 0.3


COMPILED = """
from drivers.simulated.devices import open_simulated
from drivers.simulated.rendering.render import _render_rows
from tests.drivers.rigs import small_rig

assert not _render_rows.signatures
open_simulated(small_rig(scene="plane"))
assert _render_rows.signatures
"""


def test_pictures_are_compiled_before_a_camera_has_to_be_in_time() -> None:
    subprocess.run([sys.executable, "-c", COMPILED], check=True, cwd=Path(__file__).parents[3])
