import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.radiometry.response_fit import ResponseFit, fit_response, predict_each
from instrument.files.validation import InvalidInputError

SHARED = Path(os.environ.get("HALFANGLE_SHARED_DATA", Path(__file__).parents[4] / "shared" / "data"))

TIMES = 2.0 ** np.arange(-5, 4)


def srgb_encoded(x: np.ndarray) -> np.ndarray:
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1.0 / 2.4) - 0.055)


def gamma_encoded(x: np.ndarray) -> np.ndarray:
    return x ** (1.0 / 2.2)


def tone_mapped(x: np.ndarray) -> np.ndarray:
    """An S-curve on top of sRGB, as phones put it."""
    e = srgb_encoded(x)
    return 0.5 * e + 0.5 * e * e * (3.0 - 2.0 * e)


def bracket(encode: Callable[[np.ndarray], np.ndarray], times: np.ndarray = TIMES, seed: int = 0) -> np.ndarray:
    """8-bit pictures of even patches of three decades of light, with shot noise and noise of 0.6 counts."""
    rng = np.random.default_rng(seed)
    grey, colour = rng.uniform(-1.5, 1.5, (18, 28, 1)), 0.15 * rng.standard_normal((18, 28, 3))
    light = np.kron(10.0 ** (grey + colour), np.ones((6, 6, 1)))
    x = light * times[:, None, None, None]
    x = np.clip(x + np.sqrt(x / 2e4) * rng.standard_normal(x.shape), 0.0, 1.0)
    return np.clip(np.round(255.0 * encode(x) + 0.6 * rng.standard_normal(x.shape)), 0, 255).astype(np.uint8)


def curve_error(fit: ResponseFit, encode: Callable[[np.ndarray], np.ndarray], levels: list[int]) -> np.ndarray:
    """Return log found less log true, the same at mid-range, shape (n_channels, n_levels)."""
    x = np.linspace(0.0, 1.0, 200_001)
    true = np.interp(np.arange(256), 255.0 * encode(x), x)
    found = fit.response.curve / fit.response.curve[:, 128:129] * true[128]
    return np.log(found[:, levels] / true[levels])


@pytest.mark.parametrize("encode", [srgb_encoded, gamma_encoded, tone_mapped])
@pytest.mark.parametrize("time_error", [0.0, 0.02])
def test_the_curve_of_a_camera_is_found_whether_its_times_are_right_or_not(encode, time_error: float):
    off = np.exp(time_error * np.random.default_rng(1).standard_normal(len(TIMES)))
    fit = fit_response(bracket(encode, TIMES * off), TIMES)
    levels = [20, 40, 80, 120, 160, 200, 230, 248]
    error = curve_error(fit, encode, levels)
    assert np.abs(error).max() < 0.025
    assert np.sqrt(np.mean((error / fit.response.sigma[:, levels].clip(1e-3)) ** 2)) < 2.0
    found = np.log(fit.exposure_times / TIMES / off)
    assert (found - found.mean()).std() < 0.004
    assert fit.slope == pytest.approx(1.0, abs=0.01)
    assert (np.diff(fit.response.curve, axis=1) > 0.0).all()


def test_each_picture_follows_from_the_others():
    pictures = bracket(tone_mapped)
    predictions = predict_each(pictures, TIMES, smoothness=1.0)
    assert [p.exposure_time for p in predictions] == TIMES.tolist()
    assert all(p.n > 20 for p in predictions)
    assert all(p.rms_counts < 2.5 for p in predictions)
    assert all(abs(p.offset) < 0.02 for p in predictions)


def test_a_picture_that_was_brighter_than_its_time_says_so():
    times = TIMES.copy()
    times[4] *= 1.15
    predictions = predict_each(bracket(srgb_encoded, times), TIMES, smoothness=1.0)
    assert predictions[4].offset == pytest.approx(np.log(1.15), abs=0.03)
    assert all(abs(p.offset) < 0.06 for i, p in enumerate(predictions) if i != 4)


@pytest.mark.parametrize(
    ("which", "reason"),
    [
        (slice(2, 4), "2 of 2 are neither clipped nor black; 3 at least are needed"),
        (slice(3, 4), "span 0.0 stops; 2 at least are needed"),
    ],
)
def test_a_bracket_that_is_too_short_is_refused_with_the_reason(which: slice, reason: str):
    with pytest.raises(InvalidInputError, match=reason):
        fit_response(bracket(srgb_encoded)[which], TIMES[which])


def test_a_bracket_with_nothing_between_black_and_white_is_refused():
    pictures = np.stack([np.full((60, 80, 3), z, np.uint8) for z in (0, 0, 255, 255)])
    with pytest.raises(InvalidInputError, match="are clipped or black everywhere"):
        fit_response(pictures, TIMES[:4])


def test_pictures_of_the_wrong_kind_are_refused():
    with pytest.raises(InvalidInputError, match="allowed is 8 bit"):
        fit_response(bracket(srgb_encoded).astype(np.uint16), TIMES)
    with pytest.raises(InvalidInputError, match="there must be a positive one for each picture"):
        fit_response(bracket(srgb_encoded), -TIMES)


def real_bracket() -> tuple[np.ndarray, np.ndarray]:
    folder = SHARED / "phone_flash" / "colorcard_low"
    if not folder.is_dir():
        pytest.skip(f"the real bracket is not at {folder}; set HALFANGLE_SHARED_DATA")
    pictures = [cv2.imread(str(folder / f"{i:02}.jpg"))[..., ::-1] for i in range(1, 11)]
    return np.stack(pictures), np.array([1 / 1000, 1 / 500, 1 / 250, 1 / 125, 1 / 60, 1 / 30, 1 / 15, 1 / 6, 0.3, 0.6])


def test_a_phones_bracket_is_consistent_with_its_curve():
    """The phone's own picture control is in these: each picture follows from the others to a few counts."""
    pictures, times = real_bracket()
    fit = fit_response(pictures, times)
    predictions = predict_each(pictures, times, fit.smoothness)
    assert all(p.median_counts < 8.0 and p.rms_counts < 12.0 for p in predictions)
    assert np.median([p.rms_counts for p in predictions]) < 8.0
    assert np.abs(np.log(fit.exposure_times / times)).max() < 0.1
    assert fit.slope == pytest.approx(1.0, abs=0.04)
