import numpy as np
import pytest

from analysis.radiometry.hdr import Sensor
from analysis.radiometry.saturation import Saturation, find_saturation

SENSOR = Sensor(saturation_level=13556.0, conversion_gain=2.5, read_noise=5.0)
BLACK = 512.0


def scene(seed: int, brightest: float, n_frames: int = 3) -> list[np.ndarray]:
    """Frames of a scene of all levels up to `brightest` counts, with shot noise, as if nothing clipped."""
    rng = np.random.default_rng(seed)
    light = rng.uniform(100.0, brightest, (n_frames, 300, 400))
    return list(BLACK + light + np.sqrt(light / 2.5) * rng.standard_normal(light.shape))


def counts(frames: list[np.ndarray]) -> list[np.ndarray]:
    return [np.round(f).astype(np.uint16) for f in frames]


def found(frames: list[np.ndarray], nominal: float = 13556.0) -> Saturation:
    return find_saturation(counts(frames), nominal, BLACK, SENSOR)


def test_a_pile_up_below_the_nominal_level_is_where_the_sensor_clips():
    out = found([np.minimum(f, 13314) for f in scene(0, 20000.0)])
    np.testing.assert_array_equal(out.level, np.full((2, 2), 13314.0))
    assert out.found.all()
    np.testing.assert_allclose(out.share, 1.0 - (13314 - BLACK - 100) / 19900, atol=0.01)


def test_the_pile_up_of_any_exposure_counts():
    frames = scene(1, 6000.0, 4)
    frames[2] = np.minimum(2.0 * frames[2] + 4000.0, 13314)
    assert (found(frames).level == 13314.0).all()


def test_frames_that_do_not_clip_keep_the_nominal_level():
    out = found(scene(2, 9000.0))
    assert (out.level == 13556.0).all()
    assert not out.found.any()
    assert (out.share == 0.0).all()


@pytest.mark.parametrize("sigma", [1.5, 5.0, 20.0])
def test_a_pile_up_that_pixels_spread_is_found_at_its_lower_edge(sigma: float):
    """Each pixel clips at a level of its own; nearly all of them must lie above what is taken for it."""
    rng = np.random.default_rng(3)
    ceiling = 13314 + sigma * rng.standard_normal((300, 400))
    out = found([np.minimum(f, ceiling) for f in scene(3, 30000.0)])
    assert out.found.all()
    assert (out.level < 13314 - sigma).all()
    assert (out.level > 13314 - 6.0 * sigma - 3.0).all()


def test_each_place_of_the_cell_has_its_own_level():
    """A white balance was put on the raw counts."""
    ceiling = np.tile([[13314.0, 12000.0], [12000.0, 9800.0]], (150, 200))
    out = found([np.minimum(f, ceiling) for f in scene(4, 20000.0)])
    np.testing.assert_array_equal(out.level, [[13314, 12000], [12000, 9800]])


def test_each_channel_has_its_own_level():
    frames = [np.stack([np.minimum(f, top) for top in (13000, 12000, 11000)], axis=-1) for f in scene(5, 20000.0)]
    np.testing.assert_array_equal(found(frames).level, [13000, 12000, 11000])


def test_left_aligned_counts_clip_at_the_same_place():
    right = [np.minimum(f, 3900) for f in scene(6, 8000.0)]
    sensor = Sensor(4095.0, 2.5, 5.0)
    one = find_saturation(counts(right), 4095.0, BLACK, sensor)
    left = [16 * f for f in counts(right)]
    other = find_saturation(left, 16 * 4095.0, 16 * BLACK, Sensor(16 * 4095.0, 2.5 / 16, 5.0, step=16.0))
    np.testing.assert_array_equal(other.level, 16 * one.level)
    assert (one.level == 3900).all()


@pytest.mark.parametrize("level", [900.0, 9000.0, 13000.0])
def test_an_even_picture_is_not_mistaken_for_a_clipped_one(level: float):
    """A white card fills a narrow range of counts, but not a narrower one than its shot noise."""
    rng = np.random.default_rng(7)
    frames = [level + np.sqrt((level - BLACK) / 2.5) * rng.standard_normal((300, 400)) for _ in range(4)]
    assert not found(frames).found.any()


def test_a_dark_picture_without_noise_is_no_pile_up():
    assert not found([np.full((300, 400), 900.0)] * 2).found.any()


def test_hot_pixels_are_no_pile_up_and_hide_none():
    hot = np.random.default_rng(9).uniform(11000.0, 13556.0, (5, 7))
    frames = scene(8, 9000.0)
    for frame in frames:
        frame[::60, ::60] = hot
    assert not found(frames).found.any()
    frames = [np.minimum(f, 12000) for f in scene(8, 20000.0)]
    for frame in frames:
        frame[::60, ::60] = hot
    assert (found(frames).level == 12000.0).all()


def test_a_pile_up_above_the_nominal_level_does_not_raise_it():
    assert (found([np.minimum(f, 14000) for f in scene(9, 20000.0)]).level == 13556.0).all()


def test_a_level_from_no_frame_is_refused():
    with pytest.raises(ValueError, match="there is no frame"):
        found([])
