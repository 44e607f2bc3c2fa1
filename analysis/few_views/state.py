"""A scene under way: what was seen, materials, fields, and the passes over the pixels that change them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from dataclasses import field as default
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.few_views import kernels
from analysis.few_views.curves import NODES, Curves, curve_step
from analysis.few_views.kernels import Field, Materials, Seen, copied
from analysis.pixels.problem import n_threads

Array = NDArray[np.float64]

Labels = NDArray[np.int64]

Part = TypeVar("Part")

ALBEDO_SIGMA, COLOUR_SIGMA = 0.15, 0.10
"""Of a pixel's log albedo about its material's: common to the channels, and of each."""

FIRST_SIGMA, FIRST_SPREAD = 0.35, 0.06
"""Of a log radiance about its material's model, and of a slope about its neighbourhood's, before they are learnt."""

SIGMAS, SPREADS = (0.03, 1.0), (0.004, 0.15)
"""Between which they are learnt."""

_BLOCK, _SUM_BLOCK = 1024, 8192  # pixels that a thread takes at a time; sums over blocks are added in order


@dataclass
class State:
    """The unknowns of a scene; its arrays change in place.

    Attributes
    ----------
    seen : Seen
    shape : (int, int)
        Rows and columns of the area.
    dark : float
        e of `kernels`, radiance.
    curves : Curves
        Of the K pure materials.
    mixtures : list of (int, int, float)
        Further labels K, K + 1, ...: materials a and b, and the share of b.
    sigma, spread : ndarray, shape (number of labels,)
        Of a log radiance about the model, and of a slope about its neighbourhood.
    field : Field
    correlation : float
        Of the channels' residuals.
    system : ndarray, shape (K, C, J, J), or None
        The curves' normal equations at the last step.
    threads : int or None
    """

    seen: Seen
    shape: tuple[int, int]
    dark: float
    curves: Curves
    sigma: Array
    spread: Array
    field: Field
    mixtures: list[tuple[int, int, float]] = default(default_factory=list)
    correlation: float = 0.6
    system: Array | None = None
    threads: int | None = None

    @property
    def n_materials(self) -> int:
        """K, without mixtures."""
        return len(self.curves.value)

    @property
    def n_channels(self) -> int:
        """C."""
        return int(self.seen.radiance.shape[2])

    @property
    def channel_weight(self) -> float:
        """What one of C correlated samples counts: C of them tell as much as C / (1 + (C - 1) rho) independent ones."""
        return 1.0 / (1.0 + (self.n_channels - 1) * self.correlation)

    def materials(self) -> Materials:
        """Return materials and mixtures as the kernels take them."""
        table = self.curves.table()
        mixed = [np.log((1.0 - share) * np.exp(table[a]) + share * np.exp(table[b])) for a, b, share in self.mixtures]
        if mixed:
            table = np.concatenate([table, np.stack(mixed)])
        C = self.n_channels
        covariance = ALBEDO_SIGMA**2 * np.ones((C, C)) + COLOUR_SIGMA**2 * np.eye(C)
        weight = self.channel_weight / self.sigma**2
        return Materials(np.ascontiguousarray(table), weight, np.asarray(np.linalg.inv(covariance)), self.dark)

    def leading(self) -> Labels:
        """Return the material of each pixel, of a mixture that with the larger share, shape (P,)."""
        parts = [a if share < 0.5 else b for a, b, share in self.mixtures]
        return np.concatenate([np.arange(self.n_materials), np.array(parts, np.int64)])[self.field.material]

    def fit(self, n_steps: int = 6, pixels: Labels | None = None) -> None:
        """Move pixels to their most likely slopes and albedos."""
        materials = self.materials()
        pixels = np.arange(len(self.field.loss)) if pixels is None else pixels

        def block(first: int) -> None:
            kernels.fit_pixels(pixels[first : first + _BLOCK], self.seen, materials, self.field, n_steps)

        self._in_threads(block, len(pixels))

    def kept_if_better(self, slope: Array, n_steps: int = 6, margin: float = 0.0) -> None:
        """Fit all pixels from other slopes, and keep what is more likely."""
        before = copied(self.field)
        self.field.slope[:] = slope
        self.field.albedo[:] = 0.0
        self.fit(n_steps)
        worse = ~(self.field.loss < before.loss - margin)
        for new, old in zip(self.field, before, strict=True):
            new[worse] = old[worse]

    def update_curves(self, n: int) -> None:
        """Move the curves `n` steps, and learn how far samples are from them."""
        for _ in range(n):
            self._step_curves()

    def _step_curves(self) -> None:
        materials, K = self.materials(), self.n_materials
        shape = (len(materials.table), self.n_channels, len(NODES))

        def block(first: int) -> tuple[Array, Array, Array]:
            S, rhs, misfit = np.zeros((*shape, shape[-1])), np.zeros(shape), np.zeros((shape[0], 4))
            last = min(first + _SUM_BLOCK, len(self.field.loss))
            kernels.curve_equations(first, last, self.seen, materials, self.field, NODES, S, rhs, misfit)
            return S, rhs, misfit

        parts = self._in_threads(block, len(self.field.loss), _SUM_BLOCK)
        S, rhs, misfit = (np.sum(arrays, axis=0) for arrays in zip(*parts, strict=True))
        self.system = S[:K]
        self.curves = curve_step(self.curves, S[:K], rhs[:K])
        self._learn_sigma(misfit)

    def _learn_sigma(self, misfit: Array) -> None:
        """Learn sigmas and the channels' correlation, counting the parameters that the samples decided."""
        C, K = self.n_channels, self.n_materials
        if C > 1 and misfit[:, 2].sum() > 0.0:
            pairs = C * (C - 1) / 2.0
            rho = (misfit[:, 3].sum() / pairs) / (misfit[:, 2].sum() / C)
            self.correlation = float(np.clip(rho, 0.0, 0.95))
        n_samples = self.seen.valid.sum(axis=(0, 2)) * self.channel_weight
        groups = [np.flatnonzero(np.arange(len(misfit)) == k) for k in range(K)]
        groups.append(np.arange(K, len(misfit)))  # mixtures have one sigma
        for group in groups:
            own = np.isin(self.field.material, group)
            if len(group) == 0 or misfit[group, 1].sum() == 0.0 or not own.any():
                continue
            n, used = float(n_samples[own].mean()), float(self.field.n_used[own].mean())
            variance = misfit[group, 0].sum() / misfit[group, 1].sum() * n / (n - min(used, n - 1.5))
            self.sigma[group] = np.clip(np.sqrt(variance), *SIGMAS)

    def centre_albedos(self) -> None:
        """Let each curve take over the mean of its pixels' albedos."""
        shift = np.zeros(self.curves.value.shape[:2])
        for k in range(self.n_materials):
            own = self.field.material == k
            if own.any():
                shift[k] = self.field.albedo[own].mean(axis=0)
                self.field.albedo[own] -= shift[k]
        self.curves = self.curves.shifted(shift)

    def normals(self) -> Array:
        """Return the most likely unit normals, shape (P, 3)."""
        p, q = self.field.slope.T
        return np.asarray(np.stack([-p, -q, np.ones_like(p)], axis=1) / np.sqrt(1.0 + p * p + q * q)[:, None])

    def predict(self, seen: Seen, pixels: Labels) -> Array:
        """Return what views show of some pixels with their most likely slopes, shape (V, P, C)."""
        materials, C = self.materials(), self.n_channels
        out = np.empty((len(seen.half), len(pixels), C))

        def block(first: int) -> None:
            part = np.empty((len(seen.half), len(pixels[first : first + _BLOCK]), C))
            kernels.predict(pixels[first : first + _BLOCK], seen, materials, self.field, part)
            out[:, first : first + _BLOCK] = part

        self._in_threads(block, len(pixels))
        return out

    def _in_threads(self, block: Callable[[int], Part], n: int, size: int = _BLOCK) -> list[Part]:
        with ThreadPoolExecutor(self.threads or n_threads()) as pool:
            return list(pool.map(block, range(0, n, size)))
