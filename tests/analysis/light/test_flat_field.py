import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.camera.view import View
from analysis.light.flat_field import FlatField, fit_flat_card, fit_flat_field, square_view
from analysis.light.flat_samples import PlanePicture
from analysis.radiometry.hdr import Radiance
from analysis.radiometry.response import Response
from analysis.radiometry.response_fit import fit_response
from instrument.files.validation import InvalidInputError
from tests.analysis.light.flats import prediction_error
from tests.analysis.radiometry.responses import gamma_response
from tests.analysis.radiometry.test_response_fit import real_bracket

SHARED = Path(os.environ.get("HALFANGLE_SHARED_DATA", Path(__file__).parents[4] / "shared" / "data"))

WIDTH, HEIGHT, FOCAL = 320, 240, 400.0
MATRIX = np.array([[FOCAL, 0.0, 161.0], [0.0, FOCAL, 118.0], [0.0, 0.0, 1.0]])
OFFSET = np.array([15.0, 5.0, 0.0])
CENTRE, A, LOBE = np.array([164.0, 115.0]), (-0.5, -0.15), 2.5


def view(distance: float, tilt_deg: float = 0.0, azimuth_deg: float = 0.0) -> View:
    """A plane whose origin lies on the optical axis; at no tilt it faces the camera."""
    axis = np.array([np.cos(np.deg2rad(azimuth_deg)), np.sin(np.deg2rad(azimuth_deg)), 0.0])
    tilted = cv2.Rodrigues(np.deg2rad(tilt_deg) * axis)[0]
    return View(MATRIX, np.zeros(5), tilted @ np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, distance]))


def card(seen: View, power: float = 1.0, noise: float = 0.003, seed: int = 0) -> np.ndarray:
    """Radiance of a Lambertian plane, traced pixel by pixel: vignetting, lobe cos^m, cosine law."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    ray = np.stack([(x - MATRIX[0, 2]) / FOCAL, (y - MATRIX[1, 2]) / FOCAL, np.ones_like(x, float)], axis=-1)
    normal = seen.rotation @ [0.0, 0.0, 1.0]
    point = ray * ((normal @ seen.translation) / (ray @ normal))[..., None]
    to_light = OFFSET - point
    d = np.linalg.norm(to_light, axis=-1)
    r2 = ((x - CENTRE[0]) ** 2 + (y - CENTRE[1]) ** 2) / (WIDTH**2 + HEIGHT**2) * 4.0
    gain = np.exp(A[0] * r2 + A[1] * r2**2) * (-to_light[..., 2] / d) ** LOBE
    clean = 1e8 * power * gain * (to_light @ normal) / d**3
    return clean * (1.0 + noise * rng.standard_normal(clean.shape))


def picture(seen: View, name: str = "flat", clipped: np.ndarray | None = None, **options) -> PlanePicture:
    mean = card(seen, **options).astype(np.float32)
    saturated = np.zeros(mean.shape, np.bool_) if clipped is None else clipped
    variance = (0.003 * mean) ** 2
    return PlanePicture(name, Radiance(mean, variance, saturated, np.ones(mean.shape, np.uint8)), seen)


def poses() -> list[PlanePicture]:
    seen = [view(150.0), view(250.0, 15.0, 20.0), view(400.0, 25.0, 130.0), view(200.0, 20.0, 250.0)]
    return [picture(v, f"flats/{i}", power=1.0 + 0.02 * (-1) ** i, seed=i) for i, v in enumerate(seen)]


def true_gain(pixels: np.ndarray, depth: float) -> np.ndarray:
    r2 = np.sum((pixels - CENTRE) ** 2, axis=-1) / (WIDTH**2 + HEIGHT**2) * 4.0
    ray = np.concatenate([(pixels - MATRIX[:2, 2]) / FOCAL, np.ones((*pixels.shape[:-1], 1))], axis=-1)
    from_light = ray * depth - OFFSET
    cos_alpha = from_light[..., 2] / np.linalg.norm(from_light, axis=-1)
    return np.exp(A[0] * r2 + A[1] * r2**2) * cos_alpha**LOBE


PIXELS = np.stack(np.meshgrid(np.linspace(4, WIDTH - 5, 15), np.linspace(4, HEIGHT - 5, 11)), axis=-1)


def gain_error(field: FlatField, depth: float) -> float:
    ratio = field.gain(PIXELS, depth) / true_gain(PIXELS, depth)
    return float(np.abs(ratio / np.median(ratio) - 1.0).max())


@pytest.mark.parametrize("depth", [120.0, 300.0, 600.0])
def test_vignetting_times_lobe_is_right_at_any_distance(depth: float):
    assert gain_error(fit_flat_field(poses(), OFFSET), depth) < 0.01


def test_a_plane_that_was_left_out_is_predicted_to_a_percent():
    pictures = poses()
    for i in range(len(pictures)):
        field = fit_flat_field([p for k, p in enumerate(pictures) if k != i], OFFSET)
        assert prediction_error(field, pictures[i]) < 0.01


def test_vignetting_of_another_law_and_a_card_with_some_sheen_are_predicted_to_a_percent():
    pictures = poses()
    x, y = np.meshgrid(np.arange(WIDTH) - 161.0, np.arange(HEIGHT) - 118.0)
    r = np.hypot(x, y) / FOCAL
    for p in pictures:
        # A backscattering card: brighter where the light, and the eye beside it, look straight on.
        ray = np.stack([x / FOCAL, y / FOCAL, np.ones_like(x)], axis=-1)
        cosine = -(ray @ p.view.rotation[:, 2]) / np.linalg.norm(ray, axis=-1)
        p.radiance.mean[:] *= (1.0 + r * r) ** -2.0 * (1.0 - 0.2 * r**3) * (1.0 + 0.03 * cosine**4)
    for i in range(len(pictures)):
        field = fit_flat_field([p for k, p in enumerate(pictures) if k != i], OFFSET)
        assert prediction_error(field, pictures[i]) < 0.01


def test_dust_on_the_card_does_not_bend_the_field():
    pictures = poses()
    pictures[1].radiance.mean[100:130, 60:90] *= 0.7
    assert gain_error(fit_flat_field(pictures, OFFSET), 250.0) < 0.01


def test_the_map_is_the_gain_of_every_pixel():
    field = fit_flat_field(poses(), OFFSET)
    gains = field.map(250.0)
    assert gains.shape == (HEIGHT, WIDTH)
    assert gains[30, 40] == pytest.approx(float(field.gain(np.array([40.0, 30.0]), 250.0)))
    assert field.max_gain(250.0) == pytest.approx(gains.max() / gains.min(), rel=1e-3)


def test_one_square_card_gives_the_product_at_its_distance_and_says_so():
    field = fit_flat_card(picture(view(200.0)), OFFSET)
    assert field.only_at_mm == 200.0
    r = field.gain(PIXELS, 200.0) / true_gain(PIXELS, 200.0)
    # What falls off evenly to one side is taken for tilt; the light's offset makes some of that.
    u = (PIXELS - MATRIX[:2, 2]).reshape(-1, 2) / FOCAL
    slope = np.linalg.lstsq(np.column_stack([np.ones(len(u)), u]), np.log(r).ravel(), rcond=None)
    assert np.abs(np.log(r).ravel() - np.column_stack([np.ones(len(u)), u]) @ slope[0]).max() < 0.01


def test_the_tilt_of_a_single_card_is_not_taken_for_fall_off():
    square, tilted = (
        fit_flat_card(replace(picture(view(200.0, tilt)), view=view(200.0)), OFFSET) for tilt in (0.0, 3.0)
    )
    ratio = tilted.gain(PIXELS, 200.0) / square.gain(PIXELS, 200.0)
    assert np.abs(ratio / np.median(ratio) - 1.0).max() < 0.02


def test_every_bad_picture_is_named_with_its_reason():
    good = poses()
    clipped = np.zeros((HEIGHT, WIDTH), np.bool_)
    clipped[:10] = True
    dark = picture(view(300.0), "flats/dark")
    dark.radiance.variance[:] = (2.0 * dark.radiance.mean) ** 2
    small = picture(view(300.0), "flats/small")
    small = replace(small, radiance=Radiance(*(a[:100] for a in (
        small.radiance.mean, small.radiance.variance, small.radiance.saturated, small.radiance.valid
    ))))  # fmt: skip
    with pytest.raises(InvalidInputError) as caught:
        fit_flat_field([*good, picture(view(300.0), "flats/hot", clipped), dark, small], OFFSET)
    text = str(caught.value)
    assert "flats/hot: is clipped in 4.2% of its pixels, allowed is 1%; expose shorter" in text
    assert "flats/dark: is too dark" in text
    assert "flats/small: has the shape (100, 320), others (240, 320)" in text
    assert "flats/0" not in text


def test_a_card_with_a_pattern_is_refused():
    pictures = poses()
    checker = np.kron(np.indices((12, 16)).sum(axis=0) % 2, np.ones((20, 20)))
    for p in pictures:
        p.radiance.mean[:] *= 1.0 - 0.3 * checker
    with pytest.raises(InvalidInputError, match=r"flats: is not blank: .* RMS is left of a smooth fall-off"):
        fit_flat_field(pictures, OFFSET)


def test_poses_that_cannot_tell_vignetting_from_lobe_are_refused():
    with pytest.raises(InvalidInputError, match="are 2; 3 at different distances and tilts are needed"):
        fit_flat_field(poses()[:2], OFFSET)
    with pytest.raises(InvalidInputError, match="stand at distances of 200 to 210 mm, tilted by 0 deg at most"):
        fit_flat_field([picture(view(d)) for d in (200.0, 205.0, 210.0)], OFFSET)
    with pytest.raises(InvalidInputError, match="there is none; take a matte white or grey card"):
        fit_flat_field([], OFFSET)


def test_a_phones_grey_card_gives_a_smooth_flat_field():
    path = SHARED / "phone_flash" / "greycard_low.jpg"
    if not path.is_file():
        pytest.skip(f"the real grey card is not at {path}; set HALFANGLE_SHARED_DATA")
    picture = cv2.imread(str(path))[..., ::-1]
    seen = square_view(27.0 / 36.0 * picture.shape[1], (picture.shape[1], picture.shape[0]), 200.0)

    def flat_field(response: Response) -> FlatField:
        mean = response.linearise(picture)
        maps = ((0.02 * mean) ** 2, np.zeros(mean.shape, np.bool_), np.ones(mean.shape, np.uint8))
        return fit_flat_card(PlanePicture("greycard", Radiance(mean, *maps), seen), np.zeros(3))

    field = flat_field(fit_response(*real_bracket()).response)
    assert field.rms < 0.02
    assert 1.1 < field.max_gain(200.0) < 1.5
    # The curve that the other scene gave is what makes this one smooth.
    with pytest.raises(InvalidInputError, match="greycard: is not blank"):
        flat_field(gamma_response(2.2))
