from typing import Any

import numpy as np
import pytest

from drivers.registry import open_devices
from instrument.config.messages import validate
from instrument.config.rig import RigConfig
from instrument.rig.rig import Rig
from protocols.acquisition.bracket import Bracket, take_pose
from protocols.acquisition.reference_patch import ReferencePatch
from tests.drivers.rigs import small_rig


def rig_config(width: int = 320, height: int = 240, **simulation: Any) -> RigConfig:
    rig = small_rig(width, height, scene="plane", power_jitter=0.0, warm_up_drift=0.0, vignetting=0.0, **simulation)
    rig["light"]["offset_sigma_mm"] = 3.0
    return validate(RigConfig, {"name": "patch", **rig})


def brightness(rig: Rig, **target: float) -> float:
    patch = ReferencePatch(rig.config, rig.camera.describe(), rig.stage.describe())
    return take_pose(rig, target, Bracket((0.002, 0.01), 0, (64.0, 64.0)), 1, patch).reference


def test_the_patch_is_as_bright_at_every_pose_of_a_steady_light() -> None:
    with Rig.connected(rig_config(lobe_exponent=0.0), open_devices) as rig:
        values = [brightness(rig, tilt=t, turn=a) for t, a in ((0, 0), (0, 90), (20, 10), (35, 200), (50, 300))]
    assert np.std(values) < 0.03 * np.mean(values)


@pytest.mark.parametrize("gain", [0.9, 1.15])
def test_the_patch_tells_a_change_of_the_light(gain: float) -> None:
    with Rig.connected(rig_config(), open_devices) as rig:
        before = brightness(rig, tilt=20.0, turn=0.0)
        rig.light._light._world.lamp.gain = gain  # type: ignore[attr-defined]
        assert brightness(rig, tilt=20.0, turn=0.0) == pytest.approx(gain * before, rel=0.01)


def test_without_boards_in_sight_there_is_no_patch() -> None:
    config = rig_config()
    with Rig.connected(config.model_copy(update={"boards": ()}), open_devices) as rig:
        assert np.isnan(brightness(rig, tilt=0.0, turn=0.0))
