"""Finding the palette of a scene: which materials, how many, and their curves.

Pixels are first solved on their own. Groups of like pixels give candidate curves; those whose loss costs
nothing are dropped; joint steps (`analysis.palette.joint_step`) refine what is left together with normals and shares;
pixels that still do not fit are asked for a material that is missing. What decides is the loss

    mean log(1 + l_p) , l_p the mean over the views of Cauchy's loss kappa log(1 + chi^2 / kappa) ,

not a count of parameters: it carries the model's own error, so any proper criterion keeps everything.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import nnls

from analysis.palette import joint_step
from analysis.palette.joint_step import KNOTS, N_KNOTS, Shares
from analysis.palette.materials import cluster, curve_features, materials_used
from analysis.pixels.fits import PixelFits
from analysis.pixels.nnls import MAX_ATOMS
from analysis.pixels.problem import Noise, PixelProblem, n_threads
from analysis.pixels.samples import Geometry, Samples, Settings
from analysis.reflectance.dictionary import Dictionary
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette import MATERIAL_GAIN, MAX_MATERIALS, NODES, Palette

Array = NDArray[np.float64]

MAX_CANDIDATES = 12

DROP_BELOW, ADD_ABOVE = 0.003, 0.004
"""Rise of the loss for which a material is not worth keeping, and fall for which one more is worth having."""

_FIRST_STEPS, _STEPS, _MAX_ROUNDS = 2, 6, 6

_SETTLED = 1e-4  # fall of the loss below which a joint step was the last

_MISFIT = 3.0  # times the median loss, beyond which a pixel counts less

_ASKING = 0.2  # share of the pixels, those that their own curves fit best against the palette's, that ask for more

_N_ADDED = 5  # candidates among them that are tried at a time

_N_PRICED = 800  # pixels on which candidates are weighed against each other

_BLOCK = 128  # pixels whose equations are added up at a time: rounding depends on it, so it is no tile size to choose

_N_BINS = 240  # of the pooled samples of a group over t

# Priors of the logarithmic corrections: weak on their size, firmer on their bends; what was seen outweighs both.
_SIGMA_SIZE, _SIGMA_BEND = 1.0, 0.2

_MAX_CORRECTION = 1.0

_DAMPINGS = (0.0, 0.03, 0.3)


@dataclass(frozen=True)
class PaletteFit:
    """A palette and the pixels it was learnt from.

    Attributes
    ----------
    palette : Palette
    fits : PixelFits
    loss, own_loss : float
        Mean log(1 + l_p) with the palette, and of the pixels solved on their own.
    correction : ndarray, shape (K, C, N_KNOTS)
        Logarithm of the factor by which the joint steps changed each curve.
    """

    palette: Palette
    fits: PixelFits
    loss: float
    own_loss: float
    correction: Array


def find_palette(problem: PixelProblem, own: PixelFits, noise: Noise, rng: np.random.Generator) -> PaletteFit:
    """Find the palette of the pixels of `problem`.

    Parameters
    ----------
    problem : PixelProblem
        Some thousand pixels spread over the scene.
    own : PixelFits
        These pixels solved on their own.
    noise : Noise
    rng : numpy.random.Generator
    """
    search = PaletteSearch(problem, own, noise)
    state = search.solve(search.candidates(np.flatnonzero(np.isfinite(own.normals[:, 0])), MAX_CANDIDATES))
    # Refined first: between raw candidates what is model error and what is another material cannot be told.
    state = search.restart(search.drop(search.steps(state, _FIRST_STEPS), rng))
    for _ in range(_MAX_ROUNDS):
        more = search.drop(search.steps(search.more(state), _FIRST_STEPS), rng)
        if more.loss > state.loss - ADD_ABOVE:
            break
        state = more
    state = search.restart(search.steps(state, _STEPS))
    return search.restart(search.steps(state, _STEPS))


def refine_palette(problem: PixelProblem, own: PixelFits, noise: Noise, before: PaletteFit) -> PaletteFit:
    """Refine a palette, its materials kept, for a new depth, light or noise.

    Parameters
    ----------
    problem, own, noise
        As `find_palette`.
    before : PaletteFit
    """
    search = PaletteSearch(problem, own, noise)
    return search.steps(search.solve(before.palette, before, before.correction), _FIRST_STEPS)


def curve_variance(problem: PixelProblem, found: PaletteFit, noise: Noise, pixels: NDArray[np.int64]) -> Array:
    """Return what the curves' own error adds to the variance of some pixels' normals, rad^2 a tangent axis."""
    covariance = _curve_covariance(problem, found, noise)
    part = replace(found, fits=found.fits.select(pixels))
    search = PaletteSearch(problem.select(pixels), part.fits, noise)
    samples, geometry, settings, value, slope, shares = search.arguments(part)
    out = np.empty(len(pixels))
    joint_step.normal_variance_of_curves(
        samples, geometry, settings, value, slope, KNOTS, shares, covariance, 0, len(pixels), out
    )
    return out


def curve_sigma(problem: PixelProblem, found: PaletteFit, noise: Noise) -> Array:
    """Return one sigma of each curve, relative, shape (K, C, N_NODES); where nothing was seen, the prior's."""
    covariance = _curve_covariance(problem, found, noise)
    n_own = found.correction[0].size
    sigma = np.empty(found.correction.shape)
    for k in range(len(sigma)):
        own = covariance[k * n_own : (k + 1) * n_own, k * n_own : (k + 1) * n_own]
        # A material's overall level trades freely against its shares: what is known is the curve freed of it.
        w = 1.0 / np.diag(own) ** 2
        P = np.eye(n_own) - w / w.sum()
        sigma[k] = np.sqrt(np.diag(P @ own @ P.T)).reshape(sigma[k].shape)
    return np.stack([[np.interp(NODES, KNOTS, s) for s in channels] for channels in sigma])


def _curve_covariance(problem: PixelProblem, found: PaletteFit, noise: Noise) -> Array:
    S, _ = PaletteSearch(problem, found.fits, noise).system(found)
    # As the pixels' own covariance: wider where the typical residual is more than its noise.
    widening = max(1.0, float(np.nanmedian(found.fits.reduced_chi2)))
    return np.asarray(widening * cho_solve(cho_factor(S), np.eye(len(S))))


def loss_of(fits: PixelFits) -> Array:
    """Return log(1 + Cauchy's loss a view) of each pixel; NaN = not solved."""
    return np.asarray(np.log1p(fits.loss))


class PaletteSearch:
    """The pixels to learn from, and what can be done with a palette on them."""

    def __init__(self, problem: PixelProblem, own: PixelFits, noise: Noise) -> None:
        self.problem, self.own, self.noise = problem, own, noise
        self.own_loss = float(np.nanmean(loss_of(own)))

    def solve(self, palette: Palette, before: PaletteFit | None = None, correction: Array | None = None) -> PaletteFit:
        """Solve all pixels with `palette`, from the last normals."""
        start = self.own.normals if before is None else before.fits.normals
        fits = self.problem.solve_with_palette(palette, self.noise, start=start, cold=before is None)
        if correction is None:
            correction = np.zeros((*palette.curve.shape[:2], N_KNOTS))
        return PaletteFit(palette, fits, float(np.nanmean(loss_of(fits))), self.own_loss, correction)

    def candidates(self, pixels: NDArray[np.int64], most: int) -> Palette:
        """Return one curve for each group of `pixels` with like curves of their own."""
        features = curve_features(self.own, pixels)
        group = cluster(features, min(most, len(np.unique(features.round(6), axis=0))))
        curves = [
            pooled_curve(self.problem, self.own, pixels[group == g], self.noise, self.problem.dictionary)
            for g in np.unique(group)
        ]
        return Palette(np.stack(curves))

    def drop(self, state: PaletteFit, rng: np.random.Generator) -> PaletteFit:
        """Drop the material whose loss costs least while that is not worth keeping it."""
        solved = np.flatnonzero(np.isfinite(state.fits.normals[:, 0]))
        priced = np.sort(rng.choice(solved, min(_N_PRICED, len(solved)), replace=False))
        problem = self.problem.select(priced)
        kept = list(range(state.palette.n_materials))
        normals = state.fits.normals[priced]
        while len(kept) > 1:
            fits = problem.solve_with_palette(state.palette.select(kept), self.noise, start=normals, cold=False)
            loss, used = loss_of(fits), materials_used(fits)
            rises = []
            for k in range(len(kept)):
                users = np.flatnonzero((used == k).any(axis=1))
                rest = state.palette.select(kept[:k] + kept[k + 1 :])
                without = problem.select(users).solve_with_palette(rest, self.noise, start=normals[users], cold=False)
                rises.append(float(np.nansum(loss_of(without) - loss[users]) / len(priced)) if len(users) else 0.0)
            least = int(np.argmin(rises))
            if rises[least] > DROP_BELOW:
                break
            del kept[least]
        if len(kept) == state.palette.n_materials:
            return state
        return self.solve(state.palette.select(kept), state, state.correction[kept])

    def more(self, state: PaletteFit) -> PaletteFit:
        """Add candidates from the pixels that their own curves fit best against the palette's."""
        excess = loss_of(state.fits) - loss_of(self.own)
        asking = np.flatnonzero(excess > np.nanquantile(excess, 1.0 - _ASKING))
        found = self.candidates(asking, _N_ADDED)
        none = np.zeros((found.n_materials, *state.correction.shape[1:]))
        return self.solve(state.palette.joined(found), state, np.concatenate([state.correction, none]))

    def steps(self, state: PaletteFit, n: int) -> PaletteFit:
        """Make at most `n` joint steps, until one does not lower the loss."""
        for _ in range(n):
            new = self.step(state)
            limit = _misfit(state.fits)
            if _objective(new.fits, limit) > _objective(state.fits, limit) - _SETTLED:
                return new
            state = new
        return state

    def step(self, state: PaletteFit) -> PaletteFit:
        """Make one joint step, damped until the loss falls; the old state where it does not."""
        S, rhs = self.system(state)
        limit = _misfit(state.fits)
        for damping in _DAMPINGS:
            damped = S + damping * np.diag(np.diag(S))
            change = cho_solve(cho_factor(damped), rhs).reshape(state.correction.shape)
            change = np.clip(change, -_MAX_CORRECTION, _MAX_CORRECTION)
            factor = np.exp(np.stack([[np.interp(NODES, KNOTS, c) for c in channels] for channels in change]))
            new = self.solve(Palette(state.palette.curve * factor), state, state.correction + change)
            if _objective(new.fits, limit) < _objective(state.fits, limit):
                return new
        return state

    def restart(self, state: PaletteFit) -> PaletteFit:
        """Solve all pixels anew and keep what is better: a normal gone on from can be stuck at a wrong optimum."""
        anew = self.solve(state.palette)
        better = np.flatnonzero((anew.fits.loss < state.fits.loss) | np.isnan(state.fits.loss))
        fits = state.fits.replaced(better, anew.fits.select(better))
        return replace(state, fits=fits, loss=float(np.nanmean(loss_of(fits))))

    def system(self, state: PaletteFit) -> tuple[Array, Array]:
        """Return the reduced normal equations of the curves, priors included."""
        n = state.correction.size
        samples, geometry, settings, value, slope, shares = self.arguments(state)

        def block(first: int) -> tuple[Array, Array]:
            S, rhs = np.zeros((n, n)), np.zeros(n)
            last = min(first + _BLOCK, n_pixels)
            joint_step.accumulate(samples, geometry, settings, value, slope, KNOTS, shares, first, last, S, rhs)
            return S, rhs

        n_pixels = len(state.fits.normals)
        S, rhs = np.zeros((n, n)), np.zeros(n)
        # Added up block by block in order, so that the number of threads does not change a bit.
        with ThreadPoolExecutor(n_threads()) as pool:
            for S_block, rhs_block in pool.map(block, range(0, n_pixels, _BLOCK)):
                S += S_block
                rhs += rhs_block
        S = np.triu(S) + np.triu(S, 1).T
        prior = np.kron(np.eye(n // N_KNOTS), _prior())
        return S + prior, rhs - prior @ state.correction.ravel()

    def arguments(
        self, state: PaletteFit
    ) -> tuple[Samples, Geometry, Settings, NDArray[np.float32], NDArray[np.float32], Shares]:
        """Return what the kernels of `joint_step` take."""
        settings = Settings(
            self.noise.relative, self.noise.floor, MATERIAL_GAIN, MAX_MATERIALS, True, shared=True, cold=False
        )
        value, slope = state.palette.tables()
        return self.problem.samples, self.problem.geometry(), settings, value, slope, shares_of(state.fits)


def _prior() -> Array:
    """Return the precision of one curve's corrections: small, and without sharp bends."""
    bend = np.diff(np.eye(N_KNOTS), 2, axis=0)
    return np.asarray(np.eye(N_KNOTS) / _SIGMA_SIZE**2 + bend.T @ bend / _SIGMA_BEND**2)


def shares_of(fits: PixelFits) -> Shares:
    """Return a palette's fits as the joint step takes them."""
    material = materials_used(fits).astype(np.int16)
    assert material.shape[1] == MAX_ATOMS
    # The slope of the objective: a pixel that does not fit must not bend the curves of those that do.
    weight = 1.0 / np.maximum(fits.loss / _misfit(fits), 1.0)
    return Shares(fits.normals, material, np.ascontiguousarray(fits.coefficient[:, 0]), weight)


def _misfit(fits: PixelFits) -> float:
    return _MISFIT * float(np.nanmedian(fits.loss))


def _objective(fits: PixelFits, limit: float) -> float:
    """Return what joint steps lower: the mean loss of the pixels, growing but as its logarithm beyond `limit`."""
    beyond = np.maximum(fits.loss / limit, 1.0)
    return float(np.nanmean(np.minimum(fits.loss, limit) + limit * np.log(beyond)))


def pooled_curve(
    problem: PixelProblem, own: PixelFits, pixels: NDArray[np.int64], noise: Noise, dictionary: Dictionary
) -> Array:
    """Return the curve that a group of pixels has in common, shape (C, N_NODES).

    The samples of all pixels, each divided by its pixel's brightness, are averaged over bins of t and
    fitted by the dictionary, non-negative.
    """
    part, fits = problem.select(pixels), own.select(pixels)
    t, s = half_angle_and_shading(part, fits.normals)
    samples = part.samples
    gain = part.gain()
    angles = np.quantile(t[s > 0.1], [0.2, 0.4, 0.6, 0.8]) if (s > 0.1).any() else np.array([0.3])
    theta = np.broadcast_to(np.arccos(1.0 - angles**2), (len(pixels), len(angles)))
    brightness = np.exp(np.log(np.maximum(fits.brdf(Cosines.on_slice(theta)), 1e-12)).mean(axis=(1, 2)))
    edges = np.linspace(0.0, 1.0, _N_BINS + 1) ** 1.5
    index = np.clip(np.searchsorted(edges, t, "right") - 1, 0, _N_BINS - 1)
    curves = []
    for ch in range(samples.radiance.shape[2]):
        y = samples.radiance[..., ch].astype(np.float64) * gain
        variance = (samples.variance[..., ch] + noise.floor**2) * gain**2 + (noise.relative * y) ** 2
        use = np.isfinite(y) & np.isfinite(variance) & (samples.saturated[..., ch] == 0) & (s > 0.05)
        # A sample's scatter about the group's curve is some percent whatever its noise.
        scale = s * brightness
        w = np.where(use, scale**2 / np.where(use, variance + (0.03 * y) ** 2, 1.0), 0.0)
        ratio = np.where(use, y / np.where(use, scale, 1.0), 0.0)
        weight = np.bincount(index[use], w[use], _N_BINS)
        mean = np.bincount(index[use], (w * ratio)[use], _N_BINS) / np.maximum(weight, 1e-30)
        centre = np.bincount(index[use], (w * t)[use], _N_BINS) / np.maximum(weight, 1e-30)
        full = weight > 0.0
        curves.append(_fit_curve(centre[full], mean[full], np.sqrt(weight[full]), dictionary))
    return np.stack(curves)


def _fit_curve(t: Array, value: Array, root_weight: Array, dictionary: Dictionary) -> Array:
    """Fit a sum of atoms to values at t; returns it on `NODES`."""
    atoms = dictionary.slice_table().value.astype(np.float64)
    columns = np.stack([np.interp(t, NODES, atom) for atom in atoms.T], axis=1)
    # Atoms narrower than the smallest half angle seen are held down at their peak, as in the pixel solver.
    peak = atoms[0] / (3.0 * max(float(value.max(initial=0.0)), 1e-12))
    A = np.concatenate([columns * root_weight[:, None], peak[None]])
    coefficient = nnls(A, np.append(value * root_weight, 0.0))[0]
    curve = atoms @ coefficient
    return np.asarray(np.maximum(curve, 1e-4 * curve.max(initial=1e-12)))


def half_angle_and_shading(problem: PixelProblem, normals: Array) -> tuple[Array, Array]:
    """Return t = sqrt(1 - n.h) and s = max(0, n.omega_i), each of shape (N, P)."""
    omega_i, h = problem.directions()
    n_dot_h = np.sum(normals * h, axis=-1)
    return np.sqrt(np.clip(1.0 - n_dot_h, 0.0, 1.0)), np.maximum(np.sum(normals * omega_i, axis=-1), 0.0)
