"""The flat field: vignetting of the lens times the lobe of the light, from pictures of a blank plane.

A point of the plane at X in the camera frame, seen in picture v at the pixel u, has the radiance

    log I = log P_v + log(cos theta_i / d^2) + c (1 - cos theta_i) + V(u) + m log cos alpha + g.t ,

with the vignetting V(u) = a_1 r^2 + a_2 r^4 + a_3 r^6 about a centre of its own (r in half diagonals), the light's
distance d and the angle theta_i at the plane, the angle alpha at the light from the camera's axis, and t the
tangents of the ray from the light along x and y. A plane at one distance shows only the product of vignetting
and lobe: the lobe moves over the picture with distance and tilt, by the light's offset, and vignetting does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from analysis.camera.view import View, rays
from analysis.light.flat_samples import TITLE, PlanePicture, PlaneSamples, plane_samples
from analysis.radiometry.frames import MergedFrames
from analysis.robust import huber_weights, mad_sigma
from instrument.files.validation import InvalidInputError, Problem, raise_if_any

Array = NDArray[np.float64]

WARN_GAIN = 2.0
"""Correction at the worst pixel above which a report warns."""

TEXTURE = 0.02
"""RMS of log radiance about the fit above which a plane is not blank."""

MIN_PICTURES = 3

_CENTRE_SIGMA, _LOBE_SIGMA, _GRADIENT_SIGMA = 0.03, 3.0, 0.1

_POWER_SIGMA, _SHEEN_SIGMA = 0.02, 0.1

_SPREAD = 0.15  # of distances, relative, or of tilts, rad, that tells lobe and vignetting apart

_HUBER = 2.5

_ROUNDS = 4

_N_SHARED = 9  # a_1 .. a_3, centre, m, g, c; the powers follow


@dataclass(frozen=True, slots=True)
class FlatField:
    """Vignetting times lobe.

    Attributes
    ----------
    camera_matrix, distortion : ndarray, shapes (3, 3) and (5,)
    image_size : (int, int)
        Width, height.
    light_offset : ndarray, shape (3,)
        Camera frame, mm.
    vignetting : ndarray, shape (3,)
        a_1 to a_3.
    centre : ndarray, shape (2,)
        Of the vignetting, pixels.
    lobe_exponent : float
    lobe_gradient : ndarray, shape (2,)
    rms : float
        Of log radiance about the fit.
    share_clipped : float
        Largest of all pictures.
    only_at_mm : float or None
        Distance of the one card that this comes from: vignetting and lobe are confounded, and the product
        is right at that distance only. None = both are known.
    """

    camera_matrix: Array
    distortion: Array
    image_size: tuple[int, int]
    light_offset: Array
    vignetting: Array
    centre: Array
    lobe_exponent: float
    lobe_gradient: Array
    rms: float
    share_clipped: float
    only_at_mm: float | None = None

    def gain(self, pixels: Array, depth_mm: float | Array) -> Array:
        """Return vignetting times lobe at `pixels` (..., 2) of a surface at `depth_mm` along the optical axis."""
        in_camera = rays(self.camera_matrix, self.distortion, pixels) * np.asarray(depth_mm)[..., None]
        return self.gain_at(pixels, in_camera)

    def gain_at(self, pixels: Array, in_camera: Array) -> Array:
        """Return vignetting times lobe at `pixels` (..., 2) that show the points `in_camera` (..., 3), mm."""
        shared = np.concatenate(
            [self.vignetting, (self.centre - self._middle) / self._radius, [self.lobe_exponent], self.lobe_gradient]
        )
        return np.exp(_log_gain(shared, (pixels - self._middle) / self._radius, in_camera - self.light_offset))

    def map(self, depth_mm: float) -> Array:
        """Return `gain` of every pixel, shape (height, width)."""
        width, height = self.image_size
        return self.gain(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float), depth_mm)

    def max_gain(self, depth_mm: float) -> float:
        """Return by how much the worst pixel is corrected relative to the best one."""
        width, height = self.image_size
        x, y = np.linspace(0.0, width - 1.0, 41), np.linspace(0.0, height - 1.0, 31)
        gain = self.gain(np.stack(np.meshgrid(x, y), axis=-1), depth_mm)
        return float(gain.max() / gain.min())

    @property
    def _middle(self) -> Array:
        return np.asarray(self.camera_matrix[:2, 2], np.float64)

    @property
    def _radius(self) -> float:
        return float(np.hypot(*self.image_size) / 2.0)


def fit_flat_field(pictures: Sequence[PlanePicture], light_offset: Array) -> FlatField:
    """Fit vignetting and lobe to pictures of a plane at several distances and tilts.

    Parameters
    ----------
    pictures : sequence of PlanePicture
        Three or more, of one camera.
    light_offset : ndarray, shape (3,)
        Camera frame, mm.

    Raises
    ------
    InvalidInputError
        If the pictures cannot tell, with the reasons.
    """
    samples = plane_samples(pictures)
    raise_if_any(TITLE, _pose_problems([picture.view for picture in pictures]))
    field = _fit(samples, pictures[0], np.asarray(light_offset, np.float64), _priors(len(pictures)))
    raise_if_any(TITLE, _texture_problems(field.rms, "flats"))
    return field


def fit_flat_card(picture: PlanePicture, light_offset: Array) -> FlatField:
    """Fit the product of vignetting and lobe to one card, held square to the camera at a distance that is known.

    The two are confounded: the product is right at this distance only. What falls off evenly to one side is laid
    to a card that was not quite square.

    Parameters
    ----------
    picture : PlanePicture
        Its view has the distance as translation (`square_view`).
    light_offset : ndarray, shape (3,)
        Camera frame, mm.

    Raises
    ------
    InvalidInputError
        If the picture is clipped, too dark or not of a blank card.
    """
    samples = plane_samples([picture])
    sigma = _priors(1)
    # Neither lobe nor sheen can be told from vignetting, nor its centre from tilt.
    sigma[[3, 4, 5, 8]] = 1e-6
    sigma[6:8] = np.inf
    field = _fit(samples, picture, np.asarray(light_offset, np.float64), sigma)
    raise_if_any(TITLE, _texture_problems(field.rms, picture.name))
    distance = float(np.ravel(picture.view.translation)[2])
    return replace(field, lobe_exponent=0.0, lobe_gradient=np.zeros(2), only_at_mm=distance)


def square_view(focal_length_px: float, image_size: tuple[int, int], distance_mm: float) -> View:
    """Return how a camera without distortion sees a card that it faces squarely."""
    width, height = image_size
    matrix = np.array(
        [[focal_length_px, 0.0, (width - 1) / 2.0], [0.0, focal_length_px, (height - 1) / 2.0], [0.0, 0.0, 1.0]]
    )
    return View(matrix, np.zeros(5), np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, distance_mm]))


def _pose_problems(views: list[View]) -> list[Problem]:
    """Say why views of a plane cannot tell vignetting and lobe apart."""
    if len(views) < MIN_PICTURES:
        what = f"are {len(views)}; {MIN_PICTURES} at different distances and tilts are needed, or one square card"
        return [Problem("flats", what)]
    distance = np.array([float(np.ravel(view.translation)[2]) for view in views])
    normal = np.stack([view.rotation[:, 2] for view in views])
    tilt = np.arccos(np.clip(normal @ normal.T, -1.0, 1.0)).max()
    if np.ptp(distance) / distance.mean() < _SPREAD and tilt < _SPREAD:
        what = (
            f"stand at distances of {distance.min():.0f} to {distance.max():.0f} mm, tilted by "
            f"{np.degrees(tilt):.0f} deg at most; 15 % or 9 deg are needed to tell vignetting from lobe"
        )
        return [Problem("flats", what)]
    return []


def _texture_problems(rms: float, name: str) -> list[Problem]:
    if rms < TEXTURE:
        return []
    what = f"is not blank: {rms:.1%} RMS is left of a smooth fall-off, allowed is {TEXTURE:.0%}; use a clean matte card"
    return [Problem(name, what)]


def _priors(n_pictures: int) -> Array:
    """Return the standard deviation of each parameter's prior, of mean 0."""
    shared = [np.inf] * 3 + [_CENTRE_SIGMA] * 2 + [_LOBE_SIGMA] + [_GRADIENT_SIGMA] * 2 + [_SHEEN_SIGMA]
    return np.array(shared + [_POWER_SIGMA] * n_pictures + [np.inf])


def _log_gain(shared: Array, u: Array, from_light: Array) -> Array:
    """Return V(u) + m log cos alpha + g.t for (a_1, a_2, a_3, centre, m, g)."""
    r2 = np.sum((u - shared[3:5]) ** 2, axis=-1)
    cos_alpha = from_light[..., 2] / np.linalg.norm(from_light, axis=-1)
    tangent = from_light[..., :2] / from_light[..., 2:]
    vignetting = r2 * (shared[0] + r2 * (shared[1] + r2 * shared[2]))
    return np.asarray(vignetting + shared[5] * np.log(cos_alpha) + tangent @ shared[6:8])


def _log_shading(samples: PlaneSamples, light_offset: Array) -> tuple[Array, Array]:
    """Return log(cos theta_i / d^2) and 1 - cos theta_i."""
    to_light = light_offset - samples.in_camera
    d = np.linalg.norm(to_light, axis=-1)
    cos_i = np.sum(samples.normal * to_light, axis=-1) / d
    return np.log(np.maximum(cos_i, 1e-6) / d**2), 1.0 - cos_i


def _fit(samples: PlaneSamples, first: PlanePicture, light_offset: Array, sigma: Array) -> FlatField:
    """Fit all parameters, robustly [huber1964]: dust and a logo are no part of the fall-off."""
    height, width = first.radiance.mean.shape[:2]
    middle, radius = np.asarray(first.view.camera_matrix[:2, 2]), float(np.hypot(width, height) / 2.0)
    u = (samples.pixel - middle) / radius
    shading, sheen = _log_shading(samples, light_offset)
    from_light = samples.in_camera - light_offset
    y = samples.log_radiance - shading

    def residual(x: Array) -> Array:
        power = x[_N_SHARED:-1][samples.picture] + x[-1]
        return np.asarray(y - power - _log_gain(x, u, from_light) - x[8] * sheen)

    def penalised(x: Array, scale: Array) -> Array:
        return np.concatenate([residual(x) / scale, x / sigma])

    x, weight, noise = np.zeros(len(sigma)), np.ones(len(y)), 0.01
    x[-1] = np.median(y)
    for _ in range(_ROUNDS):
        x = least_squares(penalised, x, method="lm", args=(noise / np.sqrt(weight),)).x
        off = residual(x)
        noise = mad_sigma(off, 1e-4)
        weight = huber_weights(off, _HUBER * noise)
    return FlatField(
        camera_matrix=first.view.camera_matrix,
        distortion=first.view.distortion,
        image_size=(width, height),
        light_offset=light_offset,
        vignetting=x[:3],
        centre=middle + radius * x[3:5],
        lobe_exponent=float(x[5]),
        lobe_gradient=x[6:8],
        rms=float(np.sqrt(np.mean(off**2))),
        share_clipped=float(samples.share_clipped.max()),
    )


def session_flat_field(frames: MergedFrames, focal_length_px: float, light_offset: Array) -> FlatField | None:
    """Return the flat field from a session's pictures of a card, None if there are none.

    The cards are taken to be square to the camera, at the stated distances: several of them tell vignetting and
    lobe apart, one gives their product.

    Parameters
    ----------
    frames : MergedFrames
    focal_length_px : float
    light_offset : ndarray, shape (3,)
        Camera frame, mm.

    Raises
    ------
    InvalidInputError
        If the cards cannot be used, with the reasons.
    """
    times = frames.session.extra.flat_times
    if len(times) == 0:
        return None
    distances = frames.session.extra.flat_distances_mm
    if not np.isfinite(distances).all():
        what = f"{int(np.sum(~np.isfinite(distances)))} of {len(distances)} have no distance; state it in mm"
        raise InvalidInputError("The flat field cannot be found.", [Problem("flats", what)])
    cards = [_card(frames, i, t, d, focal_length_px) for i, (t, d) in enumerate(zip(times, distances, strict=True))]
    one_distance = np.ptp(distances) == 0.0
    return fit_flat_card(cards[0], light_offset) if one_distance else fit_flat_field(cards, light_offset)


def _card(frames: MergedFrames, i: int, time: float, distance_mm: float, focal_length_px: float) -> PlanePicture:
    picture = frames.single(frames.session.extra.flat_images(i), float(time))
    return PlanePicture(f"flats/{i}", picture, square_view(focal_length_px, frames.image_size, float(distance_mm)))
