"""The response curve of a camera from a bracket of a scene that did not move, after [debevec1997].

A block i of linear exposure exp(E_i), taken for t_j seconds, has the count

    z_ij = G(E_i + log t_j + d_j) + noise ,     G the inverse of  g = log(sRGB curve) + h .

The noise is in the counts. Least squares of g(z_ij) - E_i - log t_j, as in the paper, would be smaller for a curve
that is flatter, and makes it so as soon as times are free; so counts are fitted, by Gauss-Newton steps. The h
of each channel is smooth in log(z + 8), since a curve bends at its dark end most. The d_j, by which reported times are
off, have a prior. No picture can tell a factor of the curve from one of all light, so h is 0 at mid-range; nor a
power of the curve from one of all times, so d has no trend over log t. The smoothness is the one that predicts
blocks left out of the fit best.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import isotonic_regression

from analysis.radiometry.response import N_LEVELS, srgb
from analysis.robust import huber_weights, mad_sigma
from instrument.files.validation import Problem, raise_if_any

Array = NDArray[np.float64]

TIME_SIGMA = 0.03
"""Prior of d_j: reported times are rounded, 1/15 s for 1/16."""

MIDDLE = 128
"""Count at which h is 0."""

_KNEE, _N_KNOTS = 8.0, 24

_INDEPENDENT = 100  # blocks at most that count as independent

_COUNT_SIGMA, _LIGHT_SIGMA = 1.0, 0.003  # noise of a block: counts, and of its light (relative)

_HUBER = 2.5

_ROUNDS, _SETTLED = 15, 1e-4

_GAUGE = 1e9

N_SAMPLES = 300
"""A channel: more make the curve no better than the camera repeats itself."""

LOWEST, HIGHEST = 3, 250
"""Counts of a block's darkest and brightest pixel between which it is used: rounding and clipping rule beyond."""

_BLOCKS_ACROSS = 75  # the shorter side

_EVEN_SHARE = 0.5  # of all blocks, the most even ones

_MIN_USABLE = 0.001  # share of a picture's blocks

_MIN_STOPS = 2.0

_MIN_EXPOSURES = 3

_TITLE = "The response curve cannot be found from this bracket."


@dataclass(frozen=True, slots=True)
class State:
    """h at the knots, g (n_channels, 256), E (n_channels, n_samples), d (n_exposures,); information on h and d."""

    h: Array
    g: Array
    light: Array
    time_error: Array
    information: Array

    def log_exposure(self, samples: BracketSamples) -> Array:
        """Return E_i + log t_j + d_j, shape (n_channels, n_samples, n_exposures)."""
        return np.asarray(self.light[..., None] + np.log(samples.exposure_times) + self.time_error)

    def predicted(self, samples: BracketSamples) -> Array:
        """Return the counts that should have been seen."""
        exposure = self.log_exposure(samples)
        return np.stack([np.interp(x, g, np.arange(N_LEVELS)) for x, g in zip(exposure, self.g, strict=True)])


def _reference() -> Array:
    """Return log sRGB, its black a quarter of its darkest grey, shape (256,)."""
    return np.log(np.maximum(srgb(np.arange(N_LEVELS)), srgb(np.array(1)) / 4.0))


def solve(samples: BracketSamples, smoothness: float) -> State:
    """Take Gauss-Newton steps for h, E and d, with Huber's weights [huber1964]."""
    state = _first_state(samples)
    basis, rough = np.asarray(_spline()(_u())), smoothness * _roughness()
    for _ in range(_ROUNDS):
        before, state = state, _step(state, samples, basis, rough)
        if np.abs(state.g - before.g).max() < _SETTLED:
            break
    return state


def _first_state(samples: BracketSamples) -> State:
    n_channels = len(samples.counts)
    h, g = np.zeros((n_channels, _N_KNOTS)), np.tile(_reference(), (n_channels, 1))
    no_light, no_error = np.zeros(samples.counts.shape[:2]), np.zeros(len(samples.exposure_times))
    state = State(h, g, no_light, no_error, np.eye(h.size + len(no_error)))
    return replace(state, light=best_light(state, samples, samples.valid.astype(np.float64)))


def best_light(state: State, samples: BracketSamples, weight: Array) -> Array:
    """Return E for a given curve."""
    log_light = at(state.g, samples.counts) - np.log(samples.exposure_times) - state.time_error
    return np.asarray((weight * log_light).sum(axis=-1) / np.maximum(weight.sum(axis=-1), 1e-12))


def variance_of(state: State, samples: BracketSamples) -> Array:
    """Return the variance of g(z): noise in counts tells less where the curve is steep."""
    slope = np.gradient(state.g, axis=1)
    return np.asarray((_COUNT_SIGMA * at(slope, state.predicted(samples))) ** 2 + _LIGHT_SIGMA**2)


def misfit_of(state: State, samples: BracketSamples) -> Array:
    """Return seen less predicted counts, as a difference of g at the curve's slope there."""
    predicted = state.predicted(samples)
    return np.asarray((samples.counts - predicted) * at(np.gradient(state.g, axis=1), predicted))


def _step(state: State, samples: BracketSamples, basis: Array, rough: Array) -> State:
    n_channels, n_times, n_knots = len(samples.counts), len(samples.exposure_times), basis.shape[1]
    misfit, weight, predicted = misfit_of(state, samples), _weights(state, samples), state.predicted(samples)
    M, right = np.zeros((n_channels * n_knots + n_times,) * 2), np.zeros(n_channels * n_knots + n_times)
    times = np.arange(n_channels * n_knots, len(right))
    smooth = rough + _GAUGE * np.outer(basis[MIDDLE], basis[MIDDLE])
    for c in range(n_channels):
        A = less_mean(_rows(basis, predicted[c], n_times), weight[c]).reshape(-1, n_knots + n_times)
        y, w = less_mean(misfit[c][..., None], weight[c]).ravel(), weight[c].ravel()
        own = np.arange(c * n_knots, (c + 1) * n_knots)
        both = np.concatenate([own, times])
        # Not by BLAS, whose threads wait for each other longer than this takes when the machine is busy.
        M[np.ix_(both, both)] += np.einsum("nk,nl->kl", A, A * w[:, None])
        # More h where a count is predicted means a smaller count: the misfit grows with -h.
        right[both] -= np.einsum("nk,n->k", A, w * y)
        M[np.ix_(own, own)] += smooth
        right[own] -= smooth @ state.h[c]
    prior = _time_prior(samples.exposure_times)
    M[np.ix_(times, times)] += prior
    right[times] -= prior @ state.time_error
    move = np.linalg.solve(M, right)
    h = state.h + move[: times[0]].reshape(n_channels, n_knots)
    g = np.stack([_rising(_reference() + basis @ line) for line in h])
    moved = State(h, g, state.light, state.time_error + move[times[0] :], M)
    return replace(moved, light=best_light(moved, samples, weight))


def _weights(state: State, samples: BracketSamples) -> Array:
    """Return the weight of each misfit: Huber's, over its variance, scaled so that the residuals are as expected.

    What upsets one block upsets others of the picture too, glare and local contrast; so all blocks together
    weigh no more than `_INDEPENDENT` would, or the picture's time would follow them.
    """
    variance = variance_of(state, samples)
    z = np.abs(misfit_of(state, samples)) / np.sqrt(variance)
    scale = mad_sigma(z[samples.valid], 0.1)
    share = min(_INDEPENDENT / (samples.counts.shape[0] * samples.counts.shape[1]), 1.0)
    return np.asarray(np.where(samples.valid, share * huber_weights(z, _HUBER * scale) / variance / scale**2, 0.0))


def _time_prior(exposure_times: Array) -> Array:
    """Return the information on d: small, no trend over log t, no mean."""
    Q = np.linalg.qr(np.stack([np.ones(len(exposure_times)), np.log(exposure_times)], axis=1))[0]
    return np.asarray(np.eye(len(exposure_times)) / TIME_SIGMA**2 + _GAUGE * Q @ Q.T)


def _rows(basis: Array, predicted: Array, n_times: int) -> Array:
    """Return how g at the predicted counts less log exposure moves with h's knots and with d."""
    low = np.minimum(predicted.astype(int), N_LEVELS - 2)
    part = (predicted - low)[..., None]
    minus = np.broadcast_to(-np.eye(n_times), (*predicted.shape, n_times))
    return np.concatenate([(1.0 - part) * basis[low] + part * basis[low + 1], minus], axis=-1)


def curve_sigma(state: State) -> Array:
    """Return the standard deviation of g, shape (n_channels, 256)."""
    basis = np.asarray(_spline()(_u()))
    covariance, n = np.linalg.inv(state.information), basis.shape[1]
    blocks = [covariance[k : k + n, k : k + n] for k in range(0, n * len(state.h), n)]
    return np.stack([np.sqrt(np.maximum(np.sum(basis @ block * basis, axis=1), 0.0)) for block in blocks])


def _u() -> Array:
    return np.asarray(np.log(np.arange(N_LEVELS) + _KNEE))


def _spline() -> CubicSpline:
    """Return h of u = log(z + 8) for a unit of each knot."""
    knots = np.linspace(_u()[0], _u()[-1], _N_KNOTS)
    return CubicSpline(knots, np.eye(_N_KNOTS), bc_type="natural")


def _roughness() -> Array:
    """Return R such that h R h is the integral of (d^2 h / du^2)^2 over u; a trace of h^2 besides."""
    u = np.linspace(_u()[0], _u()[-1], 10 * _N_KNOTS)
    bend = _spline()(u, 2)
    return np.asarray(bend.T @ bend * (u[1] - u[0]) + 1e-6 * np.eye(_N_KNOTS))


def at(curve: Array, counts: Array) -> Array:
    """Interpolate curves (n_channels, 256) at counts (n_channels, ...)."""
    levels = np.arange(N_LEVELS)
    return np.stack([np.interp(c, levels, line) for c, line in zip(counts, curve, strict=True)])


def less_mean(rows: Array, weight: Array) -> Array:
    """Take from rows (n_samples, n_exposures, k) their weighted mean over the exposures."""
    total = weight.sum(axis=1)
    mean = np.einsum("ij,ijk->ik", weight, rows) / np.where(total > 0.0, total, 1.0)[:, None]
    return np.asarray(rows - mean[:, None])


def _rising(g: Array) -> Array:
    """Return the nearest curve that rises, by a little at least, so that counts can be told apart."""
    least = 1e-4 * np.arange(len(g))
    return np.asarray(isotonic_regression(g - least).x + least)


@dataclass(frozen=True, slots=True)
class BracketSamples:
    """Mean counts of even blocks.

    Attributes
    ----------
    counts : ndarray, shape (n_channels, n_samples, n_exposures)
    valid : ndarray of bool, same shape
        Not too dark in any pixel of the block, nor clipped in any channel.
    exposure_times : ndarray, shape (n_exposures,)
        Seconds, as reported.
    """

    counts: Array
    valid: NDArray[np.bool_]
    exposure_times: Array


def bracket_samples(pictures: NDArray[np.uint8], exposure_times: Array) -> BracketSamples:
    """Choose places of a bracket of a scene that did not move.

    Parameters
    ----------
    pictures : ndarray of uint8, shape (n_exposures, height, width, n_channels)
    exposure_times : ndarray, shape (n_exposures,)
        Seconds.

    Raises
    ------
    InvalidInputError
        If such a bracket cannot tell the curve, with the reasons.
    """
    raise_if_any(_TITLE, _shape_problems(pictures, exposure_times))
    block = max(min(pictures.shape[1:3]) // _BLOCKS_ACROSS, 1)
    tiles = _tiles(pictures, block)
    mean, low, high = tiles.mean(axis=-1, dtype=np.float64), tiles.min(axis=-1), tiles.max(axis=-1)
    # The camera mixed the channels after the sensor had clipped: one that clips takes the others with it.
    valid = (low >= LOWEST) & (high <= HIGHEST).all(axis=-1, keepdims=True)
    raise_if_any(_TITLE, _range_problems(valid, exposure_times))
    uneven = (high.astype(np.int64) - low).max(axis=(0, -1))
    even = np.flatnonzero(uneven <= np.quantile(uneven, _EVEN_SHARE))
    chosen = [_spread(mean[:, even, c], valid[:, even, c]) for c in range(mean.shape[-1])]
    n = min(len(c) for c in chosen)
    raise_if_any(_TITLE, _sample_problems(n))
    picked = [even[c[np.linspace(0, len(c) - 1, n).round().astype(int)]] for c in chosen]
    counts = np.stack([mean[:, p, c].T for c, p in enumerate(picked)])
    return BracketSamples(counts, np.stack([valid[:, p, c].T for c, p in enumerate(picked)]), exposure_times)


def _shape_problems(pictures: NDArray[np.uint8], exposure_times: Array) -> list[Problem]:
    if pictures.dtype != np.uint8 or pictures.ndim != 4:
        what = f"are {pictures.dtype} of shape {pictures.shape}; allowed is 8 bit, (exposures, height, width, channels)"
        return [Problem("pictures", what)]
    if exposure_times.shape != pictures.shape[:1] or not np.all(exposure_times > 0.0):
        return [Problem("exposure times", f"are {exposure_times} s; there must be a positive one for each picture")]
    return []


def _range_problems(valid: NDArray[np.bool_], exposure_times: Array) -> list[Problem]:
    """Say why a bracket with such valid blocks (n_exposures, n_blocks, n_channels) cannot tell the curve."""
    usable = valid.mean(axis=1).min(axis=-1) > _MIN_USABLE
    if not usable.any():
        return [Problem("pictures", "are clipped or black everywhere; take some between")]
    problems = []
    if usable.sum() < _MIN_EXPOSURES:
        what = f"{usable.sum()} of {len(usable)} are neither clipped nor black; {_MIN_EXPOSURES} at least are needed"
        problems.append(Problem("pictures", what))
    stops = float(np.log2(exposure_times[usable].max() / exposure_times[usable].min()))
    if stops < _MIN_STOPS:
        what = f"of usable pictures span {stops:.1f} stops; {_MIN_STOPS:g} at least are needed, 6 are good"
        problems.append(Problem("exposure times", what))
    return problems


def _sample_problems(n_samples: int) -> list[Problem]:
    if n_samples >= 20:
        return []
    what = f"have {n_samples} even places that two exposures show; 20 at least are needed: take a scene of more"
    return [Problem("pictures", what)]


def _tiles(pictures: NDArray[np.uint8], block: int) -> NDArray[np.uint8]:
    """Return square blocks, shape (n_exposures, n_blocks, n_channels, block * block)."""
    n, height, width, channels = pictures.shape
    rows, columns = height // block, width // block
    cut = pictures[:, : rows * block, : columns * block].reshape(n, rows, block, columns, block, channels)
    return cut.transpose(0, 1, 3, 5, 2, 4).reshape(n, rows * columns, channels, block * block)


def _spread(mean: Array, valid: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return up to `N_SAMPLES` of the blocks (n_exposures, n_blocks) that two exposures show, from dark to bright."""
    of_use = np.flatnonzero(valid.sum(axis=0) >= 2)
    total = np.clip(mean[:, of_use], 0, N_LEVELS - 1).sum(axis=0)
    # Evenly in brightness, not in rank: most of a picture may be of one brightness.
    order = np.argsort(total, kind="stable")
    wanted = np.linspace(total.min(initial=0.0), total.max(initial=0.0), N_SAMPLES)
    rank = np.unique(np.searchsorted(total[order], wanted).clip(0, max(len(order) - 1, 0)))
    return np.asarray(of_use[order[rank]])
