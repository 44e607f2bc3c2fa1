import numpy as np
import pytest

from drivers.camera import CameraDescription
from drivers.limits import Limits
from protocols.acquisition.sample_position import difference, light_changed

GAIN, READ, BLACK = 2.5, 3.0, 64.0
CAMERA = CameraDescription("a", "b", "c", 120, 160, 12, BLACK, 4095.0, "RGGB", GAIN, READ, Limits(1e-5, 10.0, "s"))


def scene() -> np.ndarray:
    """A picture with edges, electrons."""
    rng = np.random.default_rng(1)
    blocks = rng.uniform(200.0, 6000.0, (15, 20))
    return np.kron(blocks, np.ones((8, 8)))


def photograph(electrons: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    counts = (rng.poisson(electrons) + READ * rng.standard_normal(electrons.shape)) / GAIN + BLACK
    return np.clip(np.rint(counts), 0, 4095).astype(np.uint16)


def test_two_pictures_of_one_thing_differ_by_noise_only() -> None:
    scale, share = difference(photograph(scene(), 1), photograph(scene(), 2), CAMERA)
    assert scale == pytest.approx(1.0, abs=0.01)
    assert share < 0.002


@pytest.mark.parametrize("power", [0.8, 1.25])
def test_another_power_of_the_light_is_no_motion(power: float) -> None:
    scale, share = difference(photograph(scene(), 1), photograph(power * scene(), 2), CAMERA)
    assert scale == pytest.approx(power, rel=0.01)
    assert share < 0.005
    assert f"{power:.2f} times as bright" in light_changed(scale)


def test_a_stage_that_comes_back_half_a_pixel_off_is_no_motion() -> None:
    there = np.roll(scene(), 1, axis=1)
    _, share = difference(photograph(scene(), 1), photograph(0.5 * (scene() + there), 2), CAMERA)
    assert share < 0.02


@pytest.mark.parametrize("pixels", [4, 8, 30])
def test_a_sample_that_was_shifted_is_found(pixels: int) -> None:
    moved = np.roll(scene(), pixels, axis=0)
    _, share = difference(photograph(scene(), 1), photograph(moved, 2), CAMERA)
    assert share > 0.1


def test_a_frame_that_is_clipped_everywhere_tells_nothing() -> None:
    clipped = np.full((120, 160), 4095, np.uint16)
    assert difference(clipped, clipped, CAMERA) == (1.0, 0.0)
    assert light_changed(1.0) == ""
