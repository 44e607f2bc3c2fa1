"""How much a view tells of a pixel: Fisher information of a rough model, over what a sample may hold.

With L_v the model's radiance in view v, sigma_v its noise and p the pixel's unknowns, the information of a set of
views is M = M_0 + sum_v u_v u_v^T with u_v = (dL_v/dp) / sigma_v, where M_0 is what is known beforehand. Its inverse
bounds the covariance of any estimate.

References
----------
[fedorov1972], chapter 2; [atkinson1992].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instrument.config.protocol import ChosenConfig
from instrument.config.rig import RigConfig
from protocols.poses.rough_material import PARAMETERS, Numbers, brdf, dot, radiance, unit

Array = NDArray[np.float64]

N_CASES, MAX_NORMAL_DEG = 180, 25.0
"""Normals of a relief, spread evenly over a cap about the plate's."""

ROUGHNESS_FACTORS = (1.0 / 1.6, 1.0, 1.6)

PRIOR_SIGMA = np.array([0.3, 0.3, 1.0, 0.3, 0.3])
"""What is known beside the views of a pixel, one standard deviation, in the order of `PARAMETERS`: a relief, and that
pixels share their materials, so that lobes are known better than one pixel tells."""

RELATIVE, SHOT, READ = 0.01, 0.006, 0.001
"""Noise as shares of a white plate's radiance W: RELATIVE L (what differs from view to view, the power of the light
above all), SHOT sqrt(L W), READ W."""

MIN_COSINE = float(np.cos(np.deg2rad(75.0)))
"""Of light and view with the normal; closer to edge-on nothing is believed."""

BRDF_WEIGHT_DEG = 10.0
"""An error of 100 % of the BRDF counts as much as so many degrees of the normal."""

SLICE = np.deg2rad(np.arange(2.5, 60.0, 5.0))
"""Half angles at which the BRDF is to be known."""

_STEP = 1e-20  # of the complex step, whose error is its square


@dataclass(frozen=True)
class Cases:
    """What a pixel may be: K combinations of normal, place and material.

    Attributes
    ----------
    unknowns : ndarray, shape (K, 5)
        In the order of `PARAMETERS`; slopes are 0.
    frame : ndarray, shape (K, 3, 3)
        Two unit tangents and the normal, in the sample frame.
    point : ndarray, shape (K, 3)
        Place, mm.
    loss : ndarray, shape (K, 5, 5)
        A, so that tr(A C) is the expected loss, deg^2, of an estimate with covariance C.
    """

    unknowns: Array
    frame: Array
    point: Array
    loss: Array


def expected_cases(rig: RigConfig, chosen: ChosenConfig) -> Cases:
    """Return normals of a relief, each at one of centre and corners of the area and of one of the roughnesses."""
    normals, places, materials = _normals(), _places(rig), _materials(chosen)
    # The numbers of places and of materials have no common factor, so each meets each.
    i = np.arange(N_CASES)
    point, material = places[i % len(places)], i % len(materials)
    unknowns = np.hstack([np.zeros((N_CASES, 2)), materials[material]])
    return Cases(unknowns, _frames(normals), point, np.stack([_loss(m) for m in materials])[material])


def information_vectors(cases: Cases, lens: Array, light: Array, distance: float) -> Array:
    """Return u of V views for K cases, shape (K, V, 5); 0 where a view is too close to edge-on.

    Parameters
    ----------
    cases : Cases
    lens, light : ndarray, shape (V, 3)
        Sample frame, mm.
    distance : float
        Working distance, mm.
    """
    to_lens, to_light = (place[:, None] - cases.point for place in (lens, light))
    normals = cases.frame[:, 2]
    seen = np.minimum(dot(normals, unit(to_lens)), dot(normals, unit(to_light))) > MIN_COSINE
    u = _scaled_gradient(cases, to_lens, to_light, distance)
    return np.ascontiguousarray(np.swapaxes(np.where(seen[..., None], u, 0.0), 0, 1))


def prior_information() -> Array:
    """Return M_0, shape (5, 5)."""
    return np.diag(PRIOR_SIGMA**-2.0)


def gradient(cases: Cases, to_lens: Array, to_light: Array, distance: float) -> Array:
    """Return dL/dp, shape (V, K, 5), by a complex step [squire1998]."""
    parts = []
    for i in range(len(PARAMETERS)):
        shifted: Numbers = cases.unknowns + 1j * _STEP * (np.arange(len(PARAMETERS)) == i)
        parts.append(np.imag(radiance(shifted, cases.frame, to_lens, to_light, distance)) / _STEP)
    return np.stack(parts, axis=-1)


def _scaled_gradient(cases: Cases, to_lens: Array, to_light: Array, distance: float) -> Array:
    with np.errstate(all="ignore"):  # a surface seen from behind; it is left out afterwards
        L = np.real(radiance(cases.unknowns, cases.frame, to_lens, to_light, distance))
        sigma = np.sqrt((RELATIVE * L) ** 2 + SHOT**2 * np.maximum(L, 0.0) + READ**2)
        return np.asarray(gradient(cases, to_lens, to_light, distance) / sigma[..., None])


def _loss(material: Array) -> Array:
    """Return A: (180 / pi)^2 for slopes, BRDF_WEIGHT_DEG^2 times the mean square of d log f / dp on the slice."""
    c = np.cos(SLICE)
    A = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    A[[0, 1], [0, 1]] = np.rad2deg(1.0) ** 2
    at = material + 1j * _STEP * np.eye(3)[:, None]
    d_log_f = np.imag(np.log(brdf(at, c, c, c, np.ones_like(c)))) / _STEP
    A[2:, 2:] = BRDF_WEIGHT_DEG**2 * d_log_f @ d_log_f.T / len(c)
    return A


def _normals() -> Array:
    """Directions spread evenly over a cap by the golden angle, shape (N_CASES, 3)."""
    i = np.arange(N_CASES) + 0.5
    z = 1.0 - (1.0 - np.cos(np.deg2rad(MAX_NORMAL_DEG))) * i / N_CASES
    azimuth = np.pi * (1.0 + 5.0**0.5) * i
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(azimuth), s * np.sin(azimuth), z], axis=-1)


def _frames(normals: Array) -> Array:
    first = unit(np.cross([0.0, 1.0, 0.0], normals))
    return np.stack([first, np.cross(normals, first), normals], axis=1)


def _places(rig: RigConfig) -> Array:
    left, bottom, right, top = rig.geometry.rectangle
    return np.array([[0.0, 0.0, 0.0], *([x, y, 0.0] for x in (left, right) for y in (bottom, top))])


def _materials(chosen: ChosenConfig) -> Array:
    """Logarithms of albedo, f0 and alpha, shape (M, 3): the roughness is known to a factor only."""
    roughness = np.clip(chosen.roughness * np.array(ROUGHNESS_FACTORS), 0.2, 1.0)
    return np.stack([np.log([chosen.albedo, chosen.f0, r * r]) for r in roughness])
