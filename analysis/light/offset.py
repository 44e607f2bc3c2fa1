"""Where the light stands beside the lens, from the sample's own highlights.

The offset s is one vector in the camera frame. A wrong s turns every half vector, differently in each
pose since the sample turns under the rig, and no normal can make up for that: the residual over glossy
pixels has its minimum at the true s. Only the two components across the optical axis are found; along
it s merely scales the fall-off.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from analysis.pixels.problem import Noise, PixelProblem, sample_pixels
from analysis.reflectance.dictionary import Dictionary
from analysis.registration.lighting import LightOffset, light_position
from analysis.registration.stack import Stack
from analysis.robust import huber_weights, mad_sigma

Array = NDArray[np.float64]

N_PIXELS = 500

_CURVATURE_STEP_MM = 0.5

_BLOCKS = 6

FEW_VIEWS = 15
"""Below, single pixels cannot tell an offset of the light from a tilt of their normal; the area as a whole can."""

_POOLED_BLOCKS, _KNOTS = 32, 8

MODEL_ERROR, MODEL_ERROR_FLAT = 1.5e-3, 2.5e-3
"""Part of the offset's sigma that no number of pixels takes off, over the distance: curves that are not quite those
of the dictionary shift it along the tilt by 0.5 mm at 350 mm with the relief known, by 0.8 mm with it taken as flat."""


def estimate_light_offset(
    stack: Stack,
    dictionary: Dictionary,
    noise: Noise,
    start: LightOffset,
    rng: np.random.Generator,
    depth: Array | None = None,
) -> LightOffset:
    """Find the offset that leaves the smallest residual over the most glossy of a sample of pixels.

    Minimises sum_p dof/2 log(l_p) + the prior (s - s_0)^2 / (2 sigma_0^2): each pixel's noise level is
    profiled out, so that a few bad pixels do not decide. Nelder-Mead on the two lateral components.

    Parameters
    ----------
    stack : Stack
        With `camera_rotation`.
    dictionary : Dictionary
    noise : Noise
    start : LightOffset
        Prior mean and sigma; an infinite sigma is no prior.
    rng : numpy.random.Generator
        Draws the pixels.
    depth : ndarray, shape (H, W), or None
        Millimetres; None = flat.
    """
    first = PixelProblem(stack, dictionary, sample_pixels(stack, 4 * N_PIXELS, rng), depth)
    at_start = first.solve(noise, light_position=light_position(stack, start.value))
    contrast = _highlight_contrast(first)
    usable = np.isfinite(at_start.reduced_chi2) & np.isfinite(contrast)
    chosen = np.sort(np.flatnonzero(usable)[np.argsort(contrast[usable])[-N_PIXELS:]])
    problem = PixelProblem(stack, dictionary, first.pixels[chosen], depth)
    normals = at_start.normals[chosen]
    degrees = max(stack.n_views * stack.radiance.shape[-1] - 8, 1)

    def losses(lateral: Array) -> Array:
        offset = np.array([lateral[0], lateral[1], start.value[2]])
        fits = problem.solve(noise, start=normals, light_position=light_position(stack, offset))
        loss = np.where(np.isfinite(fits.loss), fits.loss, 1.0)
        return np.asarray(0.5 * degrees * np.log(np.maximum(loss, 1e-9)))

    def loss(lateral: Array) -> float:
        prior = np.sum(((lateral - start.value[:2]) / start.sigma[:2]) ** 2) / 2.0
        return float(losses(lateral).sum() + prior)

    reach = np.where(np.isfinite(start.sigma[:2]), np.minimum(start.sigma[:2], 4.0), 4.0)
    simplex = start.value[:2] + np.array([[0.0, 0.0], [reach[0], 0.0], [0.0, reach[1]]])
    found = minimize(
        loss,
        start.value[:2],
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.02, "fatol": 0.1, "maxfev": 60},
    )
    scatter = _sigma_at(losses, found.x, stack.grid.blocks(problem.pixels, _BLOCKS))
    distance = float(np.median(np.linalg.norm(stack.camera_position, axis=1)))
    model = distance * (MODEL_ERROR_FLAT if depth is None else MODEL_ERROR)
    # What is known beforehand is known afterwards.
    sigma = np.array([*np.minimum(np.hypot(scatter, model), start.sigma[:2]), start.sigma[2]])
    return LightOffset(np.array([*found.x, start.value[2]]), sigma)


def pooled_light_offset(stack: Stack) -> LightOffset:
    """Find the offset from all highlights together, taking the sample as flat and of one gloss.

    With too few views for normals of single pixels, averages over blocks still show where the highlight
    stands. With log I_vb + log(d^2 / cos theta_i) = s_b + g(theta_h), a whiteness for each block b and one
    curve g (piecewise linear in t = sqrt(1 - cos theta_h)), the true offset leaves the least residual.

    Parameters
    ----------
    stack : Stack
        With `camera_rotation`.
    """
    brightness, points, block = _block_medians(stack)

    def losses(lateral: Array) -> Array:
        r = _pooled_residual(stack, brightness, points, np.array([*lateral, 0.0]))
        return np.asarray(0.5 * np.sum((r / noise) ** 2, axis=0))

    def loss(lateral: Array) -> float:
        return float(np.mean(_pooled_residual(stack, brightness, points, np.array([*lateral, 0.0])) ** 2))

    found = []
    for start in 12.0 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]):
        simplex = start + 4.0 * np.array([[0, 0], [1, 0], [0, 1]])
        found.append(minimize(loss, start, method="Nelder-Mead", options={"initial_simplex": simplex, "xatol": 0.02}))
    best = min(found, key=lambda f: float(f.fun))
    noise = np.sqrt(best.fun)
    return LightOffset(np.array([*best.x, 0.0]), np.array([*_sigma_at(losses, best.x, block), np.inf]))


def _block_medians(stack: Stack) -> tuple[Array, Array, NDArray[np.int64]]:
    """Cut the area into about `_POOLED_BLOCKS` a side: brightness (N, B), centres (B, 3) and coarse block numbers."""
    n, height, width, _ = stack.radiance.shape
    size = max(min(height, width) // _POOLED_BLOCKS, 1)
    rows, columns = height // size, width // size
    cut = np.stack([stack.radiance[v, : rows * size, : columns * size].mean(axis=-1) for v in range(n)])
    tiles = cut.reshape(n, rows, size, columns, size).transpose(0, 1, 3, 2, 4).reshape(n, rows * columns, -1)
    centres = stack.grid.points()[: rows * size, : columns * size]
    centres = centres.reshape(rows, size, columns, size, 3).mean(axis=(1, 3)).reshape(-1, 3)
    seen = np.isfinite(tiles).all(axis=(0, 2))
    i, j = np.divmod(np.flatnonzero(seen), columns)
    coarse = i * _BLOCKS // rows * _BLOCKS + j * _BLOCKS // columns
    return np.median(tiles[:, seen], axis=-1), centres[seen], coarse


def _pooled_residual(stack: Stack, brightness: Array, points: Array, offset: Array) -> Array:
    """Residual of log brightness after the best whiteness per block and the best curve, Huber's weights applied."""
    to_light = light_position(stack, offset)[:, None] - points
    to_camera = stack.camera_position[:, None] - points
    d2 = np.sum(to_light**2, axis=-1)
    omega_i = to_light / np.sqrt(d2)[..., None]
    h = omega_i + to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
    t = np.sqrt(np.maximum(1.0 - h[..., 2] / np.linalg.norm(h, axis=-1), 0.0))
    floor = 1e-3 * np.median(brightness)
    y = np.log(np.maximum(brightness, floor) * d2 / omega_i[..., 2] / stack.light_power[:, None])
    knots = np.quantile(t, np.linspace(0.0, 1.0, _KNOTS))
    hats = np.stack([np.interp(t, knots, hat) for hat in np.eye(_KNOTS)], axis=-1)
    # Taking off each block's mean over the views leaves the curve alone to be fitted.
    y = y - y.mean(axis=0)
    A = (hats - hats.mean(axis=0)).reshape(-1, _KNOTS)
    weight = np.ones(y.size)
    r = y.ravel()
    for _ in range(4):
        normal = A.T @ (A * weight[:, None]) + 1e-6 * y.size * np.eye(_KNOTS)
        r = y.ravel() - A @ np.linalg.solve(normal, A.T @ (weight * y.ravel()))
        scale = mad_sigma(r, 1e-9)
        weight = huber_weights(r, 2.0 * scale)
    return np.asarray((np.sqrt(weight) * r).reshape(y.shape))


def _highlight_contrast(problem: PixelProblem) -> Array:
    """Brightest over median view of each pixel: high where a highlight passes."""
    brightness = problem.samples.radiance.mean(axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        typical = np.nanmedian(brightness, axis=0)
        return np.asarray(np.where(typical > 0.0, np.nanmax(brightness, axis=0) / typical, np.nan))


def _sigma_at(losses: Callable[[Array], Array], minimum: Array, block: NDArray[np.int64]) -> Array:
    """One standard deviation of each component: slopes of the blocks' losses over the curvature [huber1967].

    Neighbours share their model error, so the scatter of independent pixels would be far too small; whole
    blocks of the area that pull in different directions tell how well the minimum is known.
    """
    sigma = np.full(2, np.inf)
    here = losses(minimum)
    for i in range(2):
        step = np.zeros(2)
        step[i] = _CURVATURE_STEP_MM
        ahead, behind = losses(minimum + step), losses(minimum - step)
        curvature = np.sum(ahead + behind - 2.0 * here) / _CURVATURE_STEP_MM**2
        slope = np.bincount(block, (ahead - behind) / (2.0 * _CURVATURE_STEP_MM))
        if curvature > 0.0:
            sigma[i] = np.sqrt(np.sum(slope**2)) / curvature
    return sigma
