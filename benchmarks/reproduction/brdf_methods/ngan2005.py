"""Cook-Torrance and isotropic Ward fitted to the full data in the manner of [ngan2005].

The model is a Lambertian term and one lobe, each with its strength in each of three channels, the lobe's shape common
to these. What is minimised is the squared difference of the BRDFs times the cosine, weighted by solid angle, over light
and view within 80 deg of the normal. Given the shape, the strengths are linear; so they are solved for, not searched,
and the shape is found by sequential quadratic programming from the best of a grid.

The errors of `benchmarks.reproduction.brdf_domain` have no weight for solid angle, and most of their nodes lie in the
highlight. So each model is fitted once more without it: then what is fitted is just what is scored, which no other
fit of that model can beat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from analysis.reflectance.completion import THETA_D, THETA_H
from analysis.reflectance.models import GRAZING, Array, Cosines, cosines_from_angles
from benchmarks.reproduction.brdf_domain import Domain
from benchmarks.reproduction.brdf_methods.case import DOMAIN, Case

ROUGHNESSES = np.geomspace(0.004, 1.2, 48)

F0S = (0.02, 0.05, 0.12, 0.3, 0.6, 1.0)

N_STARTS = 2

Lobe = Callable[[Cosines, NDArray[np.float64]], Array]


def cook_torrance_lobe(cosines: Cosines, shape: NDArray[np.float64]) -> Array:
    """D F G / (pi n.l n.v) of [cook1982]: Beckmann, Schlick's Fresnel term of f0, V-cavities.

    Parameters
    ----------
    cosines : Cosines
    shape : ndarray, shape (2,)
        log m, f0.
    """
    m, f0 = np.exp(shape[0]), shape[1]
    c2 = cosines.n_dot_h**2
    D = np.exp(-(1.0 - c2) / (c2 * m**2)) / (m**2 * c2**2)
    F = f0 + (1.0 - f0) * (1.0 - cosines.cos_d) ** 5
    low = np.minimum(cosines.n_dot_l, cosines.n_dot_v)
    G = np.minimum(1.0, 2.0 * cosines.n_dot_h * low / np.maximum(cosines.cos_d, GRAZING))
    return np.asarray(D * F * G / (np.pi * cosines.n_dot_l * cosines.n_dot_v))


def ward_lobe(cosines: Cosines, shape: NDArray[np.float64]) -> Array:
    """exp(-tan^2 theta_h / m^2) / (4 pi m^2 sqrt(n.l n.v)) of [ward1992].

    Parameters
    ----------
    cosines : Cosines
    shape : ndarray, shape (1,)
        log m.
    """
    m = np.exp(shape[0])
    c2 = cosines.n_dot_h**2
    lobe = np.exp(-(1.0 - c2) / (c2 * m**2)) / (4.0 * np.pi * m**2)
    return np.asarray(lobe / np.sqrt(cosines.n_dot_l * cosines.n_dot_v))


def cook_torrance(case: Case) -> Array:
    """Return the fit at the nodes of the domain, shape (n, 3), 1/sr."""
    return fit(case.domain, cook_torrance_lobe, case.samples(DOMAIN), by_solid_angle(case.domain)).value


def ward(case: Case) -> Array:
    """Return the fit at the nodes of the domain, shape (n, 3), 1/sr."""
    return fit(case.domain, ward_lobe, case.samples(DOMAIN), by_solid_angle(case.domain)).value


def cook_torrance_as_scored(case: Case) -> Array:
    """Return the fit without the weight for solid angle."""
    return fit(case.domain, cook_torrance_lobe, case.samples(DOMAIN), case.domain.weight).value


def ward_as_scored(case: Case) -> Array:
    """Return the fit without the weight for solid angle."""
    return fit(case.domain, ward_lobe, case.samples(DOMAIN), case.domain.weight).value


@lru_cache(maxsize=4)
def by_solid_angle(domain: Domain) -> Array:
    """Return the cosine times the root of each node's solid angles of light and view, shape (n,).

    d omega_i d omega_o = 4 cos theta_d d omega_h d omega_d: sin theta_h d theta_h and
    sin theta_d cos theta_d d theta_d, integrated over each node's cell.
    """
    edges_h, edges_d = _edges(THETA_H), _edges(THETA_D)
    over_h, over_d = -np.diff(np.cos(edges_h)), 0.5 * np.diff(np.sin(edges_d) ** 2)
    return np.asarray(domain.weight * np.sqrt(over_h[domain.i_h] * over_d[domain.i_d]))


def _edges(nodes: Array) -> Array:
    return np.concatenate([nodes[:1], 0.5 * (nodes[1:] + nodes[:-1]), nodes[-1:]])


@dataclass(frozen=True)
class ParametricFit:
    """A fit.

    Attributes
    ----------
    shape : ndarray
        As the lobe takes it.
    diffuse, specular : ndarray, shape (3,)
        Strengths: albedo, and factor of the lobe.
    value : ndarray, shape (n, 3)
        1/sr.
    """

    shape: Array
    diffuse: Array
    specular: Array
    value: Array


def fit(domain: Domain, lobe: Lobe, truth: Array, weight: Array) -> ParametricFit:
    """Fit a Lambertian term and a lobe to values at the nodes of the domain.

    Parameters
    ----------
    domain : Domain
    lobe : callable
        `cook_torrance_lobe` or `ward_lobe`.
    truth : ndarray, shape (n, 3)
        1/sr.
    weight : ndarray, shape (n,)
        Of the differences.
    """
    cosines, flat, y = _cosines(domain), weight / np.pi, truth * weight[:, None]

    def solved(shape: Array) -> _Solved:
        return _Solved.of((lobe(cosines, shape) * weight)[None], flat, y)

    def cost(shape: Array) -> float:
        return float(solved(shape).left[0] / np.sum(y**2))

    shapes, columns = _grid(domain, lobe)
    bounds = [(np.log(ROUGHNESSES[0]), np.log(ROUGHNESSES[-1])), (0.0, 1.0)][: shapes.shape[1]]
    starts = shapes[np.argsort(_Solved.of(columns * weight, flat, y).left)[:N_STARTS]]
    found = [minimize(cost, start, method="SLSQP", bounds=bounds, options={"ftol": 1e-10}).x for start in starts]
    shape = min((*starts, *found), key=cost)
    diffuse, specular = solved(shape).diffuse[0], solved(shape).specular[0]
    return ParametricFit(shape, diffuse, specular, diffuse / np.pi + specular * lobe(cosines, shape)[:, None])


@lru_cache(maxsize=4)
def _cosines(domain: Domain) -> Cosines:
    return cosines_from_angles(domain.angles.theta_h, domain.angles.theta_d, domain.angles.phi_d)[0]


@lru_cache(maxsize=4)
def _grid(domain: Domain, lobe: Lobe) -> tuple[Array, Array]:
    """Return shapes to start from, (n_shapes, 1 or 2), and their lobes, (n_shapes, n)."""
    log_m = np.log(ROUGHNESSES)
    shapes = np.stack([grid.ravel() for grid in np.meshgrid(log_m, F0S, indexing="ij")], axis=1)
    if lobe is ward_lobe:
        shapes = log_m[:, None]
    return shapes, np.stack([lobe(_cosines(domain), shape) for shape in shapes])


@dataclass(frozen=True)
class _Solved:
    """y ~ diffuse flat + specular column, neither negative, for each of M columns and 3 channels.

    Attributes
    ----------
    diffuse, specular : ndarray, shape (M, 3)
    left : ndarray, shape (M,)
        Sum of squares that is left.
    """

    diffuse: Array
    specular: Array
    left: Array

    @classmethod
    def of(cls, columns: Array, flat: Array, y: Array) -> _Solved:
        """Solve for columns of shape (M, n), a flat one of shape (n,), data of shape (n, 3)."""
        tiny = np.finfo(float).tiny
        ff, fy = flat @ flat, flat @ y
        cc, cf, cy = np.sum(columns**2, axis=1)[:, None], (columns @ flat)[:, None], columns @ y
        determinant = np.maximum(ff * cc - cf**2, tiny)
        a, b = (cc * fy - cf * cy) / determinant, (ff * cy - cf * fy) / determinant
        # Where one would be negative it is zero, and the other stands alone.
        a, b = np.where(b < 0.0, fy / ff, a), np.where(a < 0.0, cy / np.maximum(cc, tiny), b)
        a, b = np.maximum(a, 0.0), np.maximum(b, 0.0)
        left = np.sum(y**2, axis=0) - 2.0 * (a * fy + b * cy) + a**2 * ff + 2.0 * a * b * cf + b**2 * cc
        return cls(a, b, left.sum(axis=1))
