"""Normals and materials of a scene that few views saw.

A pixel with seven views has fewer samples than unknowns worth the name. What makes it solvable is shared: curves by
material, learnt where a picture is uniform; slopes by their neighbourhood; the power of each view by all pixels. The
rounds alternate between pixels, field, labels, curves and powers, each given the others: an EM algorithm [dempster1977]
whose priors are learnt from the scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.few_views import exposure
from analysis.few_views.curves import NODES, Curves, curve_prior
from analysis.few_views.field import Smoother, Words, choose_smoother, words
from analysis.few_views.first_materials import by_colour
from analysis.few_views.kernels import Field, Seen
from analysis.few_views.labels import mix_borders, relabel
from analysis.few_views.seen import directions, gather
from analysis.few_views.state import FIRST_SIGMA, FIRST_SPREAD, SPREADS, State
from analysis.light.plane import offset_by_plane
from analysis.registration.lighting import LightOffset, light_position
from analysis.registration.stack import Stack
from analysis.stages import Track, untracked

Array = NDArray[np.float64]

Labels = NDArray[np.int64]

ROUNDS, FINE_ROUNDS = 8, 2

MOST_PIXELS = 256**2
"""More are binned to so many for the rounds that learn, and then solved with what was learnt."""

FLAT_SPREAD = 0.10
"""Of a slope about 0, one sigma, until the field is learnt."""

_RESTARTS, _RELABELS, _SMOOTHERS, _LIGHTS, _MIXING = (2, 4, 6), (1, 3), (0, 1, 3, 5), (2, 3, 5), 4

_POWER_PIXELS = 15000

_DARK_SHARE, _DARK_SIGMAS = 0.01, 3.0

_BRIGHT_ENOUGH = 2.0  # times the dark, for a sample to say something of its view's power

_FEWEST = 50  # pixels, for the scatter of a material's slopes

_SQUARES, _VARIANCES = 0.04, 0.02  # most that a pixel adds to it: a few stand in a wrong minimum


@dataclass(frozen=True)
class FewViews:
    """What was found.

    Attributes
    ----------
    stack : Stack
        As it was solved: with the powers and the light that were found.
    state : State
    smoother : Smoother
    log_power : ndarray, shape (N,)
        Of the views against their stated powers; 0 where they were taken as stated, NaN for views left out.
    offset : LightOffset or None
        Of the light, where it was found.
    """

    stack: Stack
    state: State
    smoother: Smoother
    log_power: Array
    offset: LightOffset | None


def solve_few_views(
    stack: Stack,
    *,
    find_power: bool = True,
    find_light: bool = False,
    most_pixels: int = MOST_PIXELS,
    seed: int = 0,
    threads: int | None = None,
    track: Track = untracked,
) -> FewViews:
    """Solve a scene seen by few views, its materials told by colour at first.

    Parameters
    ----------
    stack : Stack
        The sample is taken as flat: depth changes directions by less than what is found.
    find_power : bool
        Whether the views' powers are found too.
    find_light : bool
        Whether the light is placed such that the mean normal is that of the plane.
    most_pixels : int
        More are binned for the rounds that learn.
    seed : int
        Of the draw of pixels that choose the smoother.
    threads : int or None
    track : Track
        Learns how many rounds are done.
    """
    rng = np.random.default_rng(seed)
    n = binning_for(stack, most_pixels)
    run = _Rounds.begun(stack.binned(n), threads)
    for number in track(list(range(ROUNDS))):
        run.round(number, rng, find_power=find_power, find_light=find_light)
    run.state.fit()
    return (run if n == 1 else run.refined(stack, n, rng)).result(stack)


def binning_for(stack: Stack, most: int = MOST_PIXELS) -> int:
    """Return by how much a stack is binned to have at most `most` pixels."""
    return int(np.ceil(np.sqrt(stack.grid.height * stack.grid.width / most)))


@dataclass
class _Rounds:
    """A solution under way."""

    stack: Stack
    views: Labels
    state: State
    log_power: Array
    smoother: Smoother | None = None
    offset: LightOffset | None = None

    @classmethod
    def begun(cls, stack: Stack, threads: int | None) -> _Rounds:
        views = np.flatnonzero(np.isfinite(stack.light_power))
        seen = gather(stack, views)
        shape = (stack.grid.height, stack.grid.width)
        state = _first(seen, shape, dark_level(seen, stack), threads)
        return cls(stack, views, state, np.zeros(len(views)))

    def round(self, number: int, rng: np.random.Generator, *, find_power: bool, find_light: bool) -> None:
        state = self.state
        state.fit()
        if number == 0:
            state.kept_if_better(_towards_brightest(state.seen))
        if number in _RESTARTS:
            state.kept_if_better(state.field.prior, margin=1e-6)
        self._learn_field(rng, choose=number in _SMOOTHERS)
        if number in _RELABELS:
            relabel(state)
        state.centre_albedos()
        state.update_curves(2)
        if number == _MIXING:
            mix_borders(state)
        if find_power and number >= 1:
            self._find_powers(rng)
        if find_light and number in _LIGHTS:
            self._find_light()

    def _learn_field(self, rng: np.random.Generator, *, choose: bool) -> None:
        said = _words(self.state)
        if choose or self.smoother is None:
            material = self.state.leading().reshape(self.state.shape)
            self.smoother = choose_smoother(said, material, rng, self.smoother)
        _learn_prior(self.state, self.smoother, said)

    def _find_powers(self, rng: np.random.Generator) -> None:
        state, seen = self.state, self.state.seen
        n = seen.half.shape[1]
        pixels = np.sort(rng.choice(n, min(n, _POWER_PIXELS), replace=False))
        model = state.predict(seen, pixels)
        r = np.log((seen.radiance[:, pixels] + state.dark) / (model + state.dark))
        ok = (seen.valid[:, pixels] > 0) & (seen.clipped[:, pixels] == 0) & (model > _BRIGHT_ENOUGH * state.dark)
        new = exposure.stepped(self.log_power, [r[v][ok[v]] for v in range(len(r))])
        seen.log_gain[:] += (new - self.log_power).astype(np.float32)[:, None]
        self.log_power = new

    def _find_light(self) -> None:
        """Move the light so that the mean normal is z, and the slopes with it."""
        state = self.state
        mean = state.field.slope.mean(axis=0)
        self.offset = offset_by_plane(self.stack, state.normals().reshape(*state.shape, 3))
        self.stack = replace(self.stack, light_position=light_position(self.stack, self.offset.value))
        state.field.slope[:] -= mean
        state.field.prior[:] -= mean
        self._look_again()

    def _look_again(self) -> None:
        for now, new in zip(self.state.seen[3:], directions(self.stack, self.views, self.log_power), strict=True):
            now[:] = new

    def refined(self, stack: Stack, n: int, rng: np.random.Generator) -> _Rounds:
        """Return the solution at all pixels, with the materials, powers and light of the binned ones."""
        stack = replace(stack, light_position=self.stack.light_position)
        shape = (stack.grid.height, stack.grid.width)
        rows, columns = (
            np.minimum(np.arange(size) // n, less - 1) for size, less in zip(shape, self.state.shape, strict=True)
        )
        nearest = (rows[:, None] * self.state.shape[1] + columns).ravel()
        f = self.state.field
        field = Field(
            f.material[nearest],
            f.slope[nearest],
            f.albedo[nearest],
            f.prior[nearest],
            f.precision[nearest],
            f.loss[nearest],
            f.covariance[nearest],
            f.n_used[nearest],
        )
        seen = gather(stack, self.views, self.log_power)
        fine = replace(self, stack=stack, state=replace(self.state, seen=seen, shape=shape, field=field))
        for _ in range(FINE_ROUNDS):
            fine.state.fit(4)
            fine._learn_field(rng, choose=True)
        fine.state.fit(4)
        fine.state.update_curves(1)
        return fine

    def result(self, given: Stack) -> FewViews:
        log_power = np.full(given.n_views, np.nan)
        log_power[self.views] = self.log_power
        power = given.light_power * np.exp(np.nan_to_num(log_power))
        found = replace(given, light_position=self.stack.light_position, light_power=power)
        if self.offset is not None:
            found = replace(found, light_offset=self.offset.value, light_offset_sigma=self.offset.sigma)
        assert self.smoother is not None
        return FewViews(found, self.state, self.smoother, log_power, self.offset)


def dark_level(seen: Seen, stack: Stack) -> float:
    """Return e: a share of white where nothing else is known, a few sigmas of the dark where noise is."""
    lit = seen.radiance[seen.valid > 0]
    white = float(np.percentile(lit, 99)) if lit.size else 1.0
    if seen.clipped.any() or stack.variance is None:
        return _DARK_SHARE * white
    variance = np.concatenate([np.asarray(stack.variance[v])[::7, ::7].ravel() for v in range(stack.n_views)])
    noise = float(np.sqrt(np.nanpercentile(variance, 2)))
    return float(np.clip(_DARK_SIGMAS * noise, 1e-3 * white, 2.0 * _DARK_SHARE * white))


def _first(seen: Seen, shape: tuple[int, int], dark: float, threads: int | None) -> State:
    n_pixels, C = seen.radiance.shape[1:]
    material = by_colour(seen, shape, dark)
    K = int(material.max()) + 1
    nothing = np.zeros(n_pixels)
    field = Field(
        material,
        np.zeros((n_pixels, 2)),
        np.zeros((n_pixels, C)),
        np.zeros((n_pixels, 2)),
        np.full(n_pixels, FLAT_SPREAD**-2.0),
        nothing.copy(),
        np.zeros((n_pixels, 3)),
        nothing.copy(),
    )
    curves = Curves(np.tile(curve_prior()[0], (K, C, 1)))
    state = State(seen, shape, dark, curves, np.full(K, FIRST_SIGMA), np.full(K, FIRST_SPREAD), field, threads=threads)
    _set_levels(state)
    state.update_curves(6)
    return state


def _set_levels(state: State) -> None:
    """Give each curve the level of its pixels' samples."""
    seen, field = state.seen, state.field
    level = np.zeros(state.curves.value.shape[:2])
    y = np.log(seen.radiance + state.dark) - seen.log_gain[..., None]
    for k in range(state.n_materials):
        own = field.material == k
        for c in range(state.n_channels):
            ok = seen.valid[:, own, c] > 0
            level[k, c] = np.median(y[:, own, c][ok]) if ok.any() else np.median(y[..., c][seen.valid[..., c] > 0])
    middle = np.interp(np.sqrt(1.0 - np.cos(np.deg2rad(15.0))), NODES, state.curves.value[0, 0])
    state.curves = state.curves.shifted(level - middle)


def _towards_brightest(seen: Seen) -> Array:
    """Slopes that turn each pixel's brightest view into its highlight."""
    pixels = np.arange(seen.half.shape[1])
    brightest = np.where(seen.valid > 0, seen.radiance, 0.0).sum(axis=2).argmax(axis=0)
    h = seen.half[brightest, pixels].astype(np.float64)
    return np.asarray(np.clip(-h[:, :2] / h[:, 2:], -0.35, 0.35))


def _words(state: State) -> Words:
    field, shape = state.field, state.shape
    variance = 0.5 * (field.covariance[:, 0] + field.covariance[:, 2])
    return words(
        field.slope.reshape(*shape, 2),
        variance.reshape(shape),
        field.prior.reshape(*shape, 2),
        field.precision.reshape(shape),
        state.spread[field.material].reshape(shape),
    )


def _learn_prior(state: State, smoother: Smoother, said: Words) -> None:
    """Give each pixel its neighbourhood's mean as prior, and each material the scatter about it."""
    field = state.field
    prior = smoother.mean(said.slope, said.weight, state.leading().reshape(state.shape)).reshape(-1, 2)
    field.prior[:] = prior
    variance = 0.5 * (field.covariance[:, 0] + field.covariance[:, 2])
    off = ((field.slope - field.prior) ** 2).mean(axis=1)
    K = state.n_materials
    for label in range(len(state.spread)):
        own = field.material == label if label < K else field.material >= K
        if own.sum() >= _FEWEST:
            mean = np.mean(np.minimum(off[own], _SQUARES) + np.minimum(variance[own], _VARIANCES))
            state.spread[label] = np.clip(np.sqrt(mean), *SPREADS)
    field.precision[:] = 1.0 / state.spread[field.material] ** 2
