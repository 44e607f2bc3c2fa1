from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from analysis.light.flat_field import session_flat_field
from analysis.radiometry.frames import MergedFrames
from instrument.files.validation import InvalidInputError
from instrument.session.records import CameraRecord
from tests.analysis.radiometry.test_response_fit import bracket, srgb_encoded

TIMES = np.array([0.002, 0.008, 0.032])
HEIGHT, WIDTH = 120, 160
BLACK = np.array([[60.0, 64.0], [66.0, 70.0]])
GAIN, READ_NOISE, CLIPS_AT = 2.5, 3.0, 3900
RADIANCE = 10.0 ** np.random.default_rng(9).uniform(3.5, 5.3, (HEIGHT, WIDTH))


def camera(**changes: object) -> CameraRecord:
    stated = {
        "make": "", "model": "", "serial_number": "", "height": HEIGHT, "width": WIDTH, "bit_depth": 12,
        "black_level": 65.0, "saturation_value": 4095.0, "bayer_pattern": "RGGB",
        "conversion_gain": GAIN, "read_noise": READ_NOISE,
    }  # fmt: skip
    # Sessions of a later schema state more; what they state is not asked for here.
    known = CameraRecord.__dataclass_fields__
    later = {k: v for k, v in {"n_channels": 1, "dtype": "u2"}.items() if k in known}
    return CameraRecord(**{**later, **stated, **changes})


@dataclass
class FakeSession:
    """Poses of one still scene, held in memory."""

    counts: np.ndarray
    exposure_times: np.ndarray = field(default_factory=TIMES.copy)
    dark: np.ndarray | None = None
    camera: CameraRecord = field(default_factory=camera)
    path: Path = Path("fake.h5")
    response: np.ndarray | None = None
    response_times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    black_level_cell: np.ndarray | None = None
    flat_times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    flat_distances_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def nominal(self) -> "FakeSession":
        return self

    @property
    def extra(self) -> "FakeSession":
        return self

    @property
    def n_poses(self) -> int:
        return len(self.counts)

    @property
    def frame_ok(self) -> np.ndarray:
        return np.ones(self.counts.shape[:2], np.bool_)

    @property
    def pose_complete(self) -> np.ndarray:
        return np.ones(self.n_poses, np.bool_)

    @property
    def exposure_readback(self) -> np.ndarray:
        return np.tile(self.exposure_times, (self.n_poses, 1))

    def frames(self, i_pose: int) -> np.ndarray:
        return self.counts[i_pose]

    def ambient(self, i_pose: int) -> np.ndarray | None:
        return None


def counts(times: np.ndarray = TIMES, radiance: np.ndarray = RADIANCE, seed: int = 0) -> np.ndarray:
    """Counts of a mosaic: Poisson, read noise, a black level for each place, clipping below the stated level."""
    rng = np.random.default_rng(seed)
    electrons = rng.poisson(np.minimum(radiance * times[:, None, None], 1e4) * GAIN)
    electrons = electrons + READ_NOISE * rng.standard_normal(electrons.shape)
    black = np.tile(BLACK, (HEIGHT // 2, WIDTH // 2))
    return np.clip(np.round(black + electrons / GAIN), 0, CLIPS_AT).astype(np.uint16)


def poses(**options) -> np.ndarray:
    return np.stack([counts(seed=seed, **options) for seed in range(3)])


def darks() -> np.ndarray:
    return np.tile(BLACK, (3, HEIGHT // 2, WIDTH // 2)).astype(np.float32)


def bias(merged) -> float:
    seen = ~merged.saturated
    return float(np.median(merged.mean[seen] / RADIANCE[seen]) - 1.0)


def test_black_comes_from_the_darks_and_the_stated_level_is_kept_beside_it():
    frames = MergedFrames(FakeSession(poses(), dark=darks()))
    np.testing.assert_array_equal(frames.findings.black_used, BLACK)
    np.testing.assert_array_equal(frames.findings.black_nominal, np.full((2, 2), 65.0))
    assert abs(bias(frames.merge(0))) < 2e-3


def test_without_darks_the_stated_level_of_each_place_is_used():
    session = FakeSession(poses())
    assert MergedFrames(session).findings.black_dark is None
    session.black_level_cell = BLACK
    frames = MergedFrames(session)
    np.testing.assert_array_equal(frames.findings.black_used, BLACK)
    assert abs(bias(frames.merge(1))) < 2e-3


def test_a_black_level_that_is_four_counts_off_shows_in_the_exposures():
    session = FakeSession(poses())
    session.black_level_cell = BLACK + 4.0
    ratios = MergedFrames(session).findings.ratios
    np.testing.assert_allclose(ratios.black_error, -4.0, atol=1.0)
    session.black_level_cell = BLACK
    assert (np.abs(MergedFrames(session).findings.ratios.black_error) < 0.5).all()


def test_pixels_that_clip_below_the_stated_level_are_no_values():
    frames = MergedFrames(FakeSession(poses(), dark=darks()))
    np.testing.assert_array_equal(frames.findings.saturation.level, np.full((2, 2), CLIPS_AT))
    assert frames.findings.saturation.nominal == 4095.0
    merged = frames.merge(0)
    assert (RADIANCE[merged.valid == 3] * TIMES[2] < CLIPS_AT + 200.0).all()
    assert 0.0 <= frames.findings.share_all_clipped == pytest.approx(merged.saturated.mean(), abs=0.01)


def test_times_that_are_off_are_found_and_put_right():
    off = TIMES * [0.98, 1.03, 1.0]
    frames = MergedFrames(FakeSession(poses(times=off), dark=darks()))
    assert (np.abs(frames.findings.ratios.deviation) > 0.01).all()
    np.testing.assert_allclose(frames.radiometry.time_factors, [0.98, 1.03, 1.0], atol=3e-3)
    assert abs(bias(frames.merge(0))) < 2e-3


def test_ambient_light_is_taken_out():
    ambient = np.full(RADIANCE.shape, 5000.0)
    session = FakeSession(poses(radiance=RADIANCE + ambient), dark=darks())
    session.ambient = lambda i: counts(TIMES[2:], ambient, seed=7)[0] if i < 2 else None
    session.ambient_times = np.array([TIMES[2], TIMES[2], np.nan])
    frames = MergedFrames(session)
    assert abs(bias(frames.merge(0))) < 2e-3
    assert bias(frames.merge(2)) > 0.02
    assert np.median(frames.merge(0).variance / frames.merge(2).variance) > 1.05


def test_noise_that_nobody_stated_is_found_in_the_brackets():
    session = FakeSession(poses(), dark=darks(), camera=camera(conversion_gain=np.nan, read_noise=np.nan))
    frames = MergedFrames(session)
    assert frames.findings.noise_estimated
    assert frames.radiometry.sensor.conversion_gain == pytest.approx(GAIN, rel=0.1)
    assert abs(bias(frames.merge(0))) < 2e-3


def test_floating_point_pictures_with_channels_are_taken_as_they_are():
    radiance = np.stack([RADIANCE, 0.5 * RADIANCE, 0.1 * RADIANCE], axis=-1)
    pictures = (radiance * TIMES[:, None, None, None])[None].astype(np.float32)
    linear = {"bayer_pattern": "", "black_level": 0.0, "saturation_value": np.inf}
    unstated = camera(**linear, conversion_gain=np.nan, read_noise=np.nan)
    frames = MergedFrames(FakeSession(pictures, camera=unstated))
    np.testing.assert_allclose(frames.merge(0).mean, radiance, rtol=1e-3)
    assert frames.findings.saturation is None
    assert not frames.merge(0).saturated.any()


def test_eight_bit_pictures_are_made_linear_by_a_bracket_beside_them():
    times = 2.0 ** np.arange(-5, 4)
    pictures = bracket(srgb_encoded).astype(np.uint16)
    session = FakeSession(
        pictures[None, ::2], times[::2], camera=camera(bayer_pattern="", bit_depth=8, saturation_value=255.0)
    )
    session.extra.response_times, session.response_images = times, lambda i: pictures[i]
    frames = MergedFrames(session)
    assert frames.findings.response_slope == pytest.approx(1.0, abs=0.01)
    assert len(frames.findings.response_predictions) == len(times)
    session.extra.response_times, session.response = np.zeros(0), srgb_encoded_table()
    given = MergedFrames(session).merge(0)
    estimated = frames.merge(0)
    good = (estimated.valid >= 2) & (given.valid >= 2)
    ratio = estimated.mean[good] / given.mean[good]
    assert np.percentile(np.abs(np.log(ratio)), 95) < 0.03


def test_a_channel_that_clips_takes_the_others_with_it():
    pictures = np.full((3, HEIGHT, WIDTH, 3), 100, np.uint16)
    pictures[2, :, :, 0] = 255
    session = FakeSession(pictures[None], camera=camera(bayer_pattern="", bit_depth=8, saturation_value=255.0))
    session.response = srgb_encoded_table()
    merged = MergedFrames(session).merge(0)
    assert (merged.valid == 2).all()


def srgb_encoded_table() -> np.ndarray:
    x = np.linspace(0.0, 1.0, 100_001)
    return np.interp(np.arange(256), 255.0 * srgb_encoded(x), x)[None]


def test_values_that_are_no_numbers_are_counted():
    pictures = (RADIANCE * TIMES[:, None, None])[None].astype(np.float32)
    pictures[0, :, ::10] = np.nan
    unstated = camera(bayer_pattern="", black_level=0.0, saturation_value=np.inf)
    findings = MergedFrames(FakeSession(pictures, camera=unstated)).findings
    assert findings.n_nan == pytest.approx(0.1 * findings.n_sampled, rel=0.1)


def test_cards_at_stated_distances_give_a_flat_field():
    def card(i: int) -> np.ndarray:
        x, y = np.meshgrid(np.arange(WIDTH) - 79.5, np.arange(HEIGHT) - 59.5)
        r2 = (x * x + y * y) / (79.5**2 + 59.5**2)
        distance = (150.0, 220.0, 300.0)[i]
        cosine = 1.0 / np.sqrt(1.0 + (x * x + y * y) / 200.0**2)
        return counts(TIMES[1:2], 2e5 * (200.0 / distance) ** 2 * np.exp(-0.4 * r2) * cosine**3, seed=i)[0]

    session = FakeSession(poses(), dark=darks())
    assert session_flat_field(MergedFrames(session), 200.0, np.zeros(3)) is None
    session.extra.flat_times, session.flat_images = np.full(3, TIMES[1]), card
    session.flat_distances_mm = np.array([150.0, 220.0, 300.0])
    field = session_flat_field(MergedFrames(session), 200.0, np.zeros(3))
    corner, middle = field.gain(np.array([[0.0, 0.0], [79.5, 59.5]]), 250.0)
    assert corner / middle == pytest.approx(np.exp(-0.4), rel=0.02)
    session.flat_distances_mm = np.full(3, np.nan)
    with pytest.raises(InvalidInputError, match="3 of 3 have no distance; state it in mm"):
        session_flat_field(MergedFrames(session), 200.0, np.zeros(3))


def test_a_session_without_a_complete_pose_is_refused():
    class Nothing(FakeSession):
        pose_complete = np.zeros(3, np.bool_)

    with pytest.raises(InvalidInputError, match="no pose is complete; go on with `halfangle resume`"):
        MergedFrames(Nothing(poses()))
