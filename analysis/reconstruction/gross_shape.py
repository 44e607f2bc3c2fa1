"""The gross shape of a depth map, tied to the plane of the boards by the parallax between the views.

Normals leave the height of the whole area open, and a light or powers that are slightly off bend the
integrated depth into a plane and a bowl. Views from the side see it: a point that is taken too high is
looked up in the wrong place, each view in another one. With the residual r_vp of pixel p in view v at the
depth z, and its change G_vp = dr_vp / dz (the pixel fitted anew at either depth, so that nothing that
another normal could explain is taken for height), the correction c . b(x, y) minimises

    sum_vp w_vp ( r_vp + G_vp b(x_p, y_p) . c )^2 ,     b = (1, x, y, (x^2 + y^2) / 2) ,

with Huber's weights w [huber1964]. The scatter of whole blocks of the area gives its covariance.

Over a small area (under some 50 pixels a side) level and bowl are hardly told apart, and a correction of more
than a third of a pixel comes short at first; the loop over the geometry then finds the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.parallax import follow_pixels, parallax_shift
from analysis.pixels.problem import Noise, PixelProblem, sample_pixels
from analysis.pixels.samples import Samples
from analysis.reconstruction.choices import Choice
from analysis.reflectance.dictionary import Dictionary
from analysis.registration.stack import Stack
from analysis.robust import huber_weights, sandwich

Array = NDArray[np.float64]

N_TERMS = 4

N_PIXELS = 2000

SIGNIFICANT = 3.0
"""Sigmas by which a term has to differ from nothing to be corrected."""

_ROUNDS = 4

_STEP_PX = 0.35  # shift of the most slanted view by which the change of the residuals is found

_HUBER = 2.0

_BLOCKS = 6


@dataclass(frozen=True, slots=True)
class GrossShape:
    """A correction of depth, mm: coefficients . (1, x, y, (x^2 + y^2) / 2), x and y in units of half the area.

    Attributes
    ----------
    coefficients : ndarray, shape (4,)
    sigma : ndarray, shape (4,)
        One standard deviation of each.
    """

    coefficients: Array
    sigma: Array

    def depth(self, stack: Stack) -> Array:
        """Return the correction over the area, mm, shape (H, W)."""
        pixels = np.arange(stack.grid.height * stack.grid.width)
        return np.asarray((_basis(stack, pixels) @ self.coefficients).reshape(stack.grid.height, stack.grid.width))


def shape_choice(shape: GrossShape) -> Choice:
    """Return what was corrected, for the record."""
    names = ("level", "tilt along x", "tilt along y", "bowl")
    terms = zip(names, shape.coefficients, shape.sigma, strict=True)
    text = ", ".join(f"{name} {c:.4f} ± {s:.4f}" for name, c, s in terms)
    return Choice("gross shape", "tied to the plane", f"corrected by (mm, at half the area's side): {text}")


NO_SHAPE = GrossShape(np.zeros(N_TERMS), np.full(N_TERMS, np.inf))


def gross_shape(
    stack: Stack, depth: Array, dictionary: Dictionary, noise: Noise, start: GrossShape, rng: np.random.Generator
) -> GrossShape:
    """Find by how much a depth map is off in height, tilt and bend.

    Parameters
    ----------
    stack : Stack
        Registered to the plane z = 0.
    depth : ndarray, shape (H, W)
        Millimetres.
    dictionary : Dictionary
    noise : Noise
    start : GrossShape
        A correction to go on from.
    rng : numpy.random.Generator
        Draws the pixels.
    """
    pixels = sample_pixels(stack, N_PIXELS, rng)
    shift = np.linalg.norm(parallax_shift(stack, np.ones_like(depth), pixels), axis=-1)
    step = _STEP_PX / float(np.percentile(shift, 99))
    total, b = start.coefficients, _basis(stack, pixels)
    block = stack.grid.blocks(pixels, _BLOCKS)
    sigma = np.full(N_TERMS, np.inf)
    normals: Array | None = None
    for _ in range(_ROUNDS):
        z = depth + GrossShape(total, sigma).depth(stack)
        here, normals = _residuals(stack, z, pixels, dictionary, noise, normals)
        ahead, behind = (_residuals(stack, z + h, pixels, dictionary, noise, normals)[0] for h in (step, -step))
        change, sigma = _correction(here, (ahead - behind) / (2.0 * step), b, block)
        total = total + change
        if np.all(np.abs(change) < sigma):
            break
    return GrossShape(np.where(np.abs(total) > SIGNIFICANT * sigma, total, 0.0), sigma)


def _residuals(
    stack: Stack, depth: Array, pixels: NDArray[np.int64], dictionary: Dictionary, noise: Noise, start: Array | None
) -> tuple[Array, Array]:
    """Fit pixels at a depth: residuals over their sigmas, shape (N C, P), NaN where not seen; and the normals."""
    samples: Samples = follow_pixels(stack, depth, pixels)
    problem = PixelProblem(stack, dictionary, pixels, depth, samples)
    fits = problem.solve(noise, start=start)
    model = problem.model(fits)
    sigma = np.sqrt(samples.variance + (noise.relative * model) ** 2 + noise.floor**2)
    r = np.where(samples.saturated > 0, np.nan, samples.radiance - model) / sigma
    return np.moveaxis(r, 1, 2).reshape(-1, len(pixels)), fits.normals


def _correction(r: Array, G: Array, b: Array, block: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return c and its sigma."""
    ok = np.isfinite(r) & np.isfinite(G)
    w = np.where(ok, huber_weights(r, _HUBER), 0.0)
    r, G = np.where(ok, r, 0.0), np.where(ok, G, 0.0)
    information, slope = np.sum(w * G * G, axis=0), np.sum(w * G * r, axis=0)
    normal = (b * information[:, None]).T @ b
    inverse = np.linalg.pinv(normal, rcond=1e-10, hermitian=True)
    c = -inverse @ (b.T @ slope)
    pull = np.zeros((int(block.max()) + 1, N_TERMS))
    np.add.at(pull, block, b * (slope + information * (b @ c))[:, None])
    return c, np.sqrt(np.diag(sandwich(inverse, pull)))


def _basis(stack: Stack, pixels: NDArray[np.int64]) -> Array:
    grid = stack.grid
    half = 0.5 * max(grid.height, grid.width) * grid.pitch
    x, y = (grid.points_of(pixels)[:, :2] / half).T
    return np.stack([np.ones_like(x), x, y, 0.5 * (x * x + y * y)], axis=1)
