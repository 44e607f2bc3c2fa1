"""Four parametric BRDFs on the slice theta_d = 0, and their parameters back from it in closed form.

Each is a diffuse term and a lobe. At theta_h = pi / 2 the lobe vanishes and leaves the diffuse term; with it taken off,
a logarithm is a straight line, whose slope and intercept give the lobe. At theta_d = 0, n.l = n.v = n.h = c.

- Blinn-Phong: ln(f - rho_d) = ln(rho_s (b + 2) / 2 pi) + b ln c.
- Isotropic Ward [ward1992]: ln(f - rho_d) + ln c = ln(rho_s / 4 pi b^2) - tan^2 / b^2. The supplement of [hui2017]
  writes the slope as 1 / b^2; its own equation gives -1 / b^2.
- Cook-Torrance [cook1982], Beckmann: with D = exp(-tan^2 / m^2) / (m^2 c^4), G = min(1, 2 c^2) and F(0) = f0,
  ln(f - rho_d) + 6 ln c - ln G = ln(k / pi m^2) - tan^2 / m^2. Only k = rho_s f0 is seen on the slice: rho_s and f0
  apart are not, by any method.
- Ashikhmin-Shirley [ashikhmin2000], isotropic: the diffuse term is no constant but A (1 - (1 - c / 2)^5)^2,
  A = 28 rho_d (1 - rho_s) / 23 pi, and vanishes at pi / 2 as well; it is the limit of f over its shape that gives A.
  ln(f - A shape) = ln(rho_s (n + 1) / 8 pi) + (n - 1) ln c.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]

MIN_COSINE = 1e-6
"""Of "theta_h = pi / 2": the limit is taken here, since some models divide by the cosine."""

DIFFUSE_SHARE = 0.05
"""The darkest of the samples nearest to grazing that the diffuse term is the median of, as a share of all samples."""

CLEAR = 3.0
"""A lobe this many sigmas above the diffuse term counts in the line."""


@dataclass(frozen=True)
class SliceModel:
    """A model with parameters (diffuse, specular, width).

    Attributes
    ----------
    name : str
    parameters : tuple of str
        Names of the three.
    diffuse_shape : callable
        From c to the diffuse term's shape.
    abscissa : callable
        From c to what the logarithm is linear in.
    offset : callable
        From c to what is added to ln(lobe) to make it linear.
    from_line : callable
        From slope and intercept to (specular, width).
    to_line : callable
        Back.
    diffuse_scale : callable
        From the parameters to the factor of the diffuse shape, and ...
    diffuse_from_scale : callable
        ... from this factor and the specular parameter to the diffuse one.
    """

    name: str
    parameters: tuple[str, str, str]
    diffuse_shape: Callable[[Array], Array]
    abscissa: Callable[[Array], Array]
    offset: Callable[[Array], Array]
    from_line: Callable[[float, float], tuple[float, float]]
    to_line: Callable[[float, float], tuple[float, float]]
    diffuse_scale: Callable[[Array], float]
    diffuse_from_scale: Callable[[float, float], float]

    def evaluate(self, c: Array, p: Array) -> Array:
        """Return f at cosines `c` of theta_h in 1/sr, shape (n,), for parameters of shape (3,)."""
        slope, intercept = self.to_line(p[1], p[2])
        lobe = np.exp(slope * self.abscissa(c) + intercept - self.offset(c))
        return self.diffuse_scale(p) * self.diffuse_shape(c) + lobe

    def line(self, c: Array, f: Array, scale: float) -> tuple[Array, Array]:
        """Return abscissa and ordinate of the samples in which the lobe shows, given the diffuse factor."""
        lobe = f - scale * self.diffuse_shape(c)
        shows = lobe > 0.0
        return self.abscissa(c[shows]), np.log(lobe[shows]) + self.offset(c[shows])


def _tan2(c: Array) -> Array:
    return (1.0 - c**2) / c**2


def _constant(c: Array) -> Array:
    return np.ones_like(c)


def _gaussian_from_line(slope: float, intercept: float, factor: float) -> tuple[float, float]:
    """Return strength and width of factor^-1 strength width^-2 exp(-x / width^2); NaN where the line does not fall."""
    if slope >= 0.0:
        return float("nan"), float("nan")
    return float(np.exp(intercept) * factor / -slope), float((-slope) ** -0.5)


BLINN_PHONG = SliceModel(
    "Blinn-Phong",
    ("rho_d", "rho_s", "beta"),
    _constant,
    np.log,
    np.zeros_like,
    lambda slope, intercept: (float(np.exp(intercept) * 2.0 * np.pi / (slope + 2.0)), slope),
    lambda rho_s, beta: (beta, float(np.log(rho_s * (beta + 2.0) / (2.0 * np.pi)))),
    lambda p: float(p[0]),
    lambda scale, specular: scale,
)

WARD = SliceModel(
    "Ward",
    ("rho_d", "rho_s", "beta"),
    _constant,
    _tan2,
    np.log,
    lambda slope, intercept: _gaussian_from_line(slope, intercept, 4.0 * np.pi),
    lambda rho_s, beta: (-(beta**-2.0), float(np.log(rho_s / (4.0 * np.pi * beta**2)))),
    lambda p: float(p[0]),
    lambda scale, specular: scale,
)

COOK_TORRANCE = SliceModel(
    "Cook-Torrance",
    ("rho_d", "rho_s f0", "m"),
    _constant,
    _tan2,
    lambda c: 6.0 * np.log(c) - np.log(np.minimum(1.0, 2.0 * c**2)),
    lambda slope, intercept: _gaussian_from_line(slope, intercept, np.pi),
    lambda k, m: (-(m**-2.0), float(np.log(k / (np.pi * m**2)))),
    lambda p: float(p[0]),
    lambda scale, specular: scale,
)

ASHIKHMIN_SHIRLEY = SliceModel(
    "Ashikhmin-Shirley",
    ("rho_d", "rho_s", "n"),
    lambda c: (1.0 - (1.0 - 0.5 * c) ** 5) ** 2,
    np.log,
    np.zeros_like,
    lambda slope, intercept: (float(np.exp(intercept) * 8.0 * np.pi / (slope + 2.0)), slope + 1.0),
    lambda rho_s, n: (n - 1.0, float(np.log(rho_s * (n + 1.0) / (8.0 * np.pi)))),
    lambda p: float(28.0 / (23.0 * np.pi) * p[0] * (1.0 - p[1])),
    lambda scale, specular: scale * 23.0 * np.pi / (28.0 * (1.0 - specular)),
)

MODELS = (BLINN_PHONG, WARD, COOK_TORRANCE, ASHIKHMIN_SHIRLEY)


def closed_form(model: SliceModel, theta_h: Array, f: Array, noise: float) -> Array:
    """Recover the parameters from the samples nearest to grazing and the line of the others.

    Parameters
    ----------
    model : SliceModel
    theta_h, f : ndarray, shape (n,)
        Radians, ascending; 1/sr.
    noise : float
        Relative, one sigma; 0 = exact, then every sample in which the lobe shows at all is taken.

    Returns
    -------
    ndarray, shape (3,)
        NaN where no line can be drawn.
    """
    c = np.maximum(np.cos(theta_h), MIN_COSINE)
    n_dark = max(round(DIFFUSE_SHARE * len(c)), 1) if noise > 0.0 else 1
    scale = max(float(np.median((f / model.diffuse_shape(c))[-n_dark:])), 0.0)
    diffuse = scale * model.diffuse_shape(c)
    # Without noise it is rounding that the lobe must stand out from.
    sigma = np.hypot(noise * f, max(noise, 1e-9) * diffuse / np.sqrt(n_dark))
    lobe = f - diffuse
    used = lobe > CLEAR * sigma
    if np.count_nonzero(used) < 2:
        return np.full(3, np.nan)
    # d ln(lobe) = d lobe / lobe
    weight = lobe[used] / np.maximum(sigma[used], 1e-9 * f[used])
    x, y = model.abscissa(c[used]), np.log(lobe[used]) + model.offset(c[used])
    slope, intercept = np.polyfit(x, y, 1, w=weight)
    with np.errstate(invalid="ignore"):
        specular, width = model.from_line(float(slope), float(intercept))
    return np.array([model.diffuse_from_scale(scale, specular), specular, width])


def non_linear(model: SliceModel, theta_h: Array, f: Array, starts: list[Array]) -> Array:
    """Fit by least squares of relative differences over the logarithms of the parameters; the best of all starts."""
    c = np.maximum(np.cos(theta_h), MIN_COSINE)

    def residual(q: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            value = model.evaluate(c, np.exp(q)) / f - 1.0
        return np.nan_to_num(np.clip(value, -1e6, 1e6), nan=1e6)

    usable = [np.log(start) for start in starts if np.all(np.isfinite(start) & (start > 0.0))]
    found = [
        least_squares(residual, q, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=200) for q in usable
    ]
    return np.exp(min(found, key=lambda result: float(result.cost)).x)
