"""Power of the light in each view and fall-off over the picture, from the white of the boards and their border.

A white point at x, seen in view v at radius r of the picture, has the radiance

    log I = log P_v + log rho_s + log(cos theta_i / d^2) + a r^2 + b r^4 + g.u + m log cos alpha
            + c_1 (1 - cos theta_i) + c_2 (1 - cos theta_i)^2 ,

with the power P_v, the sheet's whiteness rho_s, vignetting (a, b), the lobe cos^m about the light's
axis, its gradient g over the picture where that axis is not the camera's (u = pixel from the centre
over the unit of r; an error of the light's position looks the same and goes there too), and how far the
white is from Lambertian (c_1, c_2). All are linear in the logarithm, so one regularised least-squares
fit finds them; the priors keep apart what the pictures cannot (a power that follows the tilt from a
white that is not Lambertian).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.camera.view import View
from analysis.robust import huber_weights, mad_sigma, sandwich

Array = NDArray[np.float64]

POWER_SIGMA = 0.02
"""Prior of log P_v about their mean: LEDs and pipes hold their power within a few percent."""

POWER_MODEL_ERROR = 1e-3
"""Part of a power's sigma that no number of samples takes off: a white that is not quite as it is modelled, under a
light that is not quite where it is taken to be, leaves 0.05 to 0.15 % that follow the tilt."""

_LOBE_SIGMA, _WHITE_SIGMA, _SHEET_SIGMA, _GRADIENT_SIGMA = 3.0, 0.2, 0.05, 0.05

_ROUNDS = 5  # of reweighting; the weights have settled by then

_HUBER = 2.5


@dataclass(frozen=True, slots=True)
class WhiteSamples:
    """Radiances of white points of the boards.

    Attributes
    ----------
    log_radiance : ndarray, shape (n_samples,)
        Mean over the channels, each channel's white made 1.
    view, sheet : ndarray of int, shape (n_samples,)
        The view, and the piece of paper: points on one sheet are equally white.
    point : ndarray, shape (n_samples, 3)
        Sample frame, mm.
    pixel : ndarray, shape (n_samples, 2)
        Where it lies in the picture.
    """

    log_radiance: Array
    view: NDArray[np.int64]
    sheet: NDArray[np.int64]
    point: Array
    pixel: Array


@dataclass(frozen=True, slots=True)
class Photometry:
    """What the white says.

    Attributes
    ----------
    light_power : ndarray, shape (n_views,)
        Such that the boards' white has the BRDF 1 / pi.
    light_power_sigma : ndarray, shape (n_views,)
        One standard deviation of each view's power relative to the mean power of all, as a share of it.
    vignetting : tuple of float
        a, b per `radius` squared and to the fourth.
    gradient : tuple of float
        g per `radius`, along x and y of the picture.
    lobe_exponent : float
        m.
    falloff_covariance : ndarray, shape (5, 5)
        Of g_x, g_y, a, b, m.
    principal_point, radius : (float, float), float
        Centre of the vignetting and unit of r, pixels.
    residual : ndarray, shape (n_samples,)
        Of log I, seen less fitted.
    """

    light_power: Array
    light_power_sigma: Array
    vignetting: tuple[float, float]
    gradient: tuple[float, float]
    lobe_exponent: float
    falloff_covariance: Array
    principal_point: tuple[float, float]
    radius: float
    residual: Array

    @property
    def rms(self) -> float:
        """Root mean square of the residuals of log I."""
        return float(np.sqrt(np.mean(self.residual**2)))

    def falloff(self, view: View, light_offset: Array, points: Array, pixels: Array) -> Array:
        """Return vignetting times lobe at `points` (..., 3) that lie at `pixels` (..., 2) of the picture."""
        x = np.array([*self.gradient, *self.vignetting, self.lobe_exponent])
        return np.asarray(np.exp(self._terms(view, light_offset, points, pixels) @ x))

    def falloff_sigma(self, view: View, light_offset: Array, points: Array) -> float:
        """Return the standard deviation of log falloff about its mean over `points` (n, 3), RMS over them."""
        terms = self._terms(view, light_offset, points, view.project(points))
        terms = terms - terms.mean(axis=0)
        return float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", terms, self.falloff_covariance, terms))))

    def _terms(self, view: View, light_offset: Array, points: Array, pixels: Array) -> Array:
        """Return what g_x, g_y, a, b, m are multiplied with in log falloff, shape (..., 5)."""
        u = (pixels - self.principal_point) / self.radius
        r2 = np.sum(u**2, axis=-1)
        log_lobe = np.log(_cos_alpha(view, light_offset, points))
        return np.stack([u[..., 0], u[..., 1], r2, r2**2, log_lobe], axis=-1)


def _cos_alpha(view: View, light_offset: Array, points: Array) -> Array:
    """Cosine of the angle at the light between its axis, which is the camera's, and the way to each point."""
    ray = points @ view.rotation.T + view.translation - light_offset
    return np.asarray(ray[..., 2] / np.linalg.norm(ray, axis=-1))


def fit_photometry(
    samples: WhiteSamples, views: tuple[View, ...], light_offset: Array, image_size: tuple[int, int]
) -> Photometry:
    """Fit powers, vignetting and lobe to the white, robustly.

    Parameters
    ----------
    samples : WhiteSamples
    views : tuple of View
    light_offset : ndarray, shape (3,)
        Camera frame, mm.
    image_size : (int, int)
        Width, height.
    """
    n_views, n_sheets = len(views), int(samples.sheet.max()) + 1
    matrix = views[0].camera_matrix
    centre = (float(matrix[0, 2]), float(matrix[1, 2]))
    radius = float(np.hypot(*image_size) / 2.0)
    u = (samples.pixel - centre) / radius
    r2 = np.sum(u**2, axis=1)
    cos_i, d2, log_lobe = (np.empty(len(r2)) for _ in range(3))
    for v, view in enumerate(views):
        of = samples.view == v
        light = view.rotation.T @ (light_offset - view.translation)
        to_light = light - samples.point[of]
        d2[of] = np.sum(to_light**2, axis=1)
        cos_i[of] = to_light[:, 2] / np.sqrt(d2[of])
        log_lobe[of] = np.log(_cos_alpha(view, light_offset, samples.point[of]))
    tilt = 1.0 - cos_i
    A = np.concatenate(
        [
            np.ones((len(r2), 1)),
            np.eye(n_views)[samples.view],
            np.eye(n_sheets)[samples.sheet],
            u,
            np.stack([r2, r2**2, log_lobe, tilt, tilt**2], axis=1),
        ],
        axis=1,
    )
    y = samples.log_radiance - np.log(cos_i / d2)
    sigma = np.concatenate(
        [
            [np.inf],
            np.full(n_views, POWER_SIGMA),
            np.full(n_sheets, _SHEET_SIGMA),
            [_GRADIENT_SIGMA, _GRADIENT_SIGMA, np.inf, np.inf, _LOBE_SIGMA, _WHITE_SIGMA, _WHITE_SIGMA],
        ]
    )
    x, residual, weight = _robust_ridge(A, y, sigma)
    quadrant = 2 * (samples.point[:, 0] > 0.0) + (samples.point[:, 1] > 0.0)
    covariance = _covariance(A, residual, weight, sigma, 4 * samples.view + quadrant)
    g_x, g_y, a, b, m = x[-7:-2]
    return Photometry(
        light_power=np.pi * np.exp(x[0] + x[1 : 1 + n_views]),
        light_power_sigma=np.hypot(_relative_sigma(covariance[1 : 1 + n_views, 1 : 1 + n_views]), POWER_MODEL_ERROR),
        vignetting=(float(a), float(b)),
        gradient=(float(g_x), float(g_y)),
        lobe_exponent=float(m),
        falloff_covariance=covariance[-7:-2, -7:-2],
        principal_point=centre,
        radius=radius,
        residual=residual,
    )


def _relative_sigma(covariance: Array) -> Array:
    """Return the standard deviation of each value less the mean of all."""
    n = len(covariance)
    centred = np.eye(n) - 1.0 / n
    return np.asarray(np.sqrt(np.diag(centred @ covariance @ centred)))


def _robust_ridge(A: Array, y: Array, sigma: Array) -> tuple[Array, Array, Array]:
    """Least squares with Huber's weights [huber1964] and Gaussian priors of mean 0; returns x, y - A x, weights."""
    prior = 1.0 / sigma**2
    weight = np.ones(len(y))
    noise = 0.01
    x = np.zeros(A.shape[1])
    residual = y
    for _ in range(_ROUNDS):
        normal = A.T @ (A * weight[:, None]) / noise**2 + np.diag(prior)
        x[:] = np.linalg.solve(normal + 1e-9 * np.eye(len(x)), A.T @ (weight * y) / noise**2)
        residual = y - A @ x
        noise = mad_sigma(residual, 1e-6)
        weight = huber_weights(residual, _HUBER * noise)
    return x, residual, weight


def _covariance(A: Array, residual: Array, weight: Array, sigma: Array, block: NDArray[np.int64]) -> Array:
    """Return the covariance of x from the scatter of whole blocks of samples [huber1967].

    White paper is not even: neighbours in one picture are off together, and the scatter of single samples
    would promise too much.
    """
    noise = mad_sigma(residual, 1e-6)
    normal = A.T @ (A * weight[:, None]) / noise**2 + np.diag(1.0 / sigma**2) + 1e-9 * np.eye(A.shape[1])
    pull = np.zeros((int(block.max()) + 1, A.shape[1]))
    np.add.at(pull, block, A * (weight * residual)[:, None] / noise**2)
    return sandwich(np.asarray(np.linalg.inv(normal)), pull)
