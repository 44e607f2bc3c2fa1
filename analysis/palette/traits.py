"""Material traits: how much of a pixel is metal, paint, fabric, plastic ... by the curves that its neighbours share.

The paper adds up the coefficients of a category's atoms, pixel by pixel [hui2017]. On the slice the atoms are next to
collinear, so that coefficients say nothing of single atoms; what they say together is a curve. So curves are pooled,
those of the palette or of groups of like pixels, and compared with labelled ones:

    x = log(f cos theta_h + OFFSET level),    z = W^(-1/2) B^T (x - mean)

with B the principal components of the labelled curves and W the covariance, in them, between two published fits of one
material: what two ways of measuring a material differ by is no difference of materials. The density of a curve around
a labelled one is a mixture of N(0, s^2 I): it is that material, for some s near 1, or kin of it, for a larger one. The
scale of a scene's radiances is unknown but one for all of its materials, and is integrated out.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from analysis.palette.materials import group_materials, leading_material, materials_used
from analysis.pixels.fits import PixelFits
from analysis.reflectance.atoms import published
from analysis.reflectance.categories import categories
from analysis.reflectance.models import Cosines, abc, sgd
from analysis.reflectance.palette import PALETTE, material_name

Array = NDArray[np.float64]

Names = tuple[str, ...]

OTHER = "other"

TRAITS = ("metallic-paint", "metal", "diffuse-paint", "fabric", "plastic", "acrylic", OTHER)
"""The paper's six, and what is none of them."""

GROUPED: dict[str, Names] = {
    "metallic paint + metal": ("metallic-paint", "metal"),
    "diffuse paint + fabric": ("diffuse-paint", "fabric"),
    "plastic + acrylic": ("plastic", "acrylic"),
}

TABLES: Names = ("sgd", "abc")

OFFSET = 0.1
"""Of the median over the curve: what is darker does not tell one material from another."""

N_ANGLES, N_COMPONENTS = 48, 8

_SHRINKAGE = 0.1  # of the covariance towards a sphere

_KNOWN = 0.5  # that a material is among the labelled ones

# How far two ways of measuring it differ, in units of what they do on average: matte materials agree, metals do not.
_SIZES, _KIN = (0.2, 0.5, 1.0, 2.0), 3.0

_SCALES = np.linspace(-4.0, 4.0, 81)  # of the radiances, in log

_MAX_POOLED = 400  # pixels of a group that its curve is the median of

_UNSEEN_DEG = 75.0  # beyond which fits are no measurement


@dataclass(frozen=True)
class Traits:
    """Traits of P pixels.

    Attributes
    ----------
    share : ndarray, shape (P, 7)
        Of each of `TRAITS`: how much of the pixel's light comes from a material, times how likely that is of the
        trait. Sums to 1; NaN where the pixel was not solved.
    confidence : ndarray, shape (P,)
        How likely the trait with the largest share is that of the pixel's largest material.
    """

    share: Array
    confidence: Array

    @property
    def leading(self) -> NDArray[np.int64]:
        """Index of the trait with the largest share, shape (P,); -1 = not solved."""
        solved = np.isfinite(self.share[:, 0])
        return np.where(solved, np.nan_to_num(self.share).argmax(axis=1), -1)

    def grouped(self) -> dict[str, Array]:
        """Return the paper's three maps, shape (P,) each: the traits of a group added up."""
        return {
            name: np.asarray(self.share[:, [TRAITS.index(trait) for trait in traits]].sum(axis=1))
            for name, traits in GROUPED.items()
        }


@dataclass(frozen=True)
class TraitModel:
    """Labelled curves, in coordinates in which two fits of one material differ by a unit.

    Attributes
    ----------
    theta_h : ndarray, shape (T,)
        Half angles of the curves, rad.
    mean : ndarray, shape (T * C,)
    whitening : ndarray, shape (D, T * C)
        W^(-1/2) B^T.
    point : ndarray, shape (M, D)
        The labelled curves.
    name : tuple of str, length M
        Of the labelled materials.
    """

    theta_h: Array
    mean: Array
    whitening: Array
    point: Array
    name: Names

    @property
    def trait(self) -> NDArray[np.int64]:
        """Index into `TRAITS` of each labelled curve, shape (M,)."""
        return np.array([trait_index(name) for name in self.name])

    def without(self, names: Collection[str]) -> TraitModel:
        """Return the model that has never seen these materials."""
        kept = [i for i, name in enumerate(self.name) if name not in names]
        return replace(self, point=self.point[kept], name=tuple(self.name[i] for i in kept))

    def posterior(self, curves: Array) -> Array:
        """Return how likely each curve is of each trait, shape (K, 7).

        Parameters
        ----------
        curves : ndarray, shape (K, T, C)
            On the slice at `theta_h`, all in one unit, whichever it is.
        """
        z = (_logs(self.theta_h, curves) - self.mean) @ self.whitening.T
        step = self.whitening.sum(axis=1)
        of_scale = [self._log_density(z + scale * step) for scale in _SCALES]
        log_density, trait = np.stack(of_scale), self.trait  # (scales, K, M)
        # All materials of the scene have one scale, and together say which.
        weight = logsumexp(log_density, axis=2).sum(axis=1)
        weight = np.exp(weight - logsumexp(weight))
        of_trait = np.stack(
            [np.exp(logsumexp(log_density[..., trait == i], axis=2)) for i in range(len(TRAITS))], axis=-1
        )
        share = of_trait / of_trait.sum(axis=-1, keepdims=True)
        return np.asarray(np.einsum("s,skt->kt", weight, share))

    def _log_density(self, z: Array) -> Array:
        """Return log p of points, shape (K, D), about each labelled one, shape (K, M)."""
        d2 = np.sum((z[:, None] - self.point[None]) ** 2, axis=-1)
        n = self.point.shape[1]
        weight = [*(_KNOWN / len(_SIZES) for _ in _SIZES), 1.0 - _KNOWN]
        size = (*_SIZES, _KIN)
        parts = [np.log(w) - n * np.log(s) - 0.5 * d2 / s**2 for w, s in zip(weight, size, strict=True)]
        # Each trait counts as much as another, however many materials the tables have of it.
        prior = -np.log(np.bincount(self.trait))[self.trait]
        return np.asarray(logsumexp(parts, axis=0) + prior)


def trait_model(theta_h: Array, *, tables: Names = TABLES, judged: Collection[str] = ()) -> TraitModel:
    """Return a model of the published materials at these half angles.

    Parameters
    ----------
    theta_h : ndarray, shape (T,)
        Radians.
    tables : tuple of str
        Of which the labelled curves are.
    judged : collection of str
        Materials that the covariance between the tables is not taken from, because they are to be judged by it.
    """
    names = tuple(sorted(set.intersection(*(set(map(str, published(t)["name"])) for t in TABLES))))
    logs = {table: _logs(theta_h, _published_curves(table, names, theta_h)) for table in TABLES}
    mean = np.concatenate(list(logs.values())).mean(axis=0)
    basis = np.linalg.svd(np.concatenate(list(logs.values())) - mean, full_matrices=False)[2][:N_COMPONENTS]
    kept = np.array([name not in judged for name in names])
    whitening = _inverse_root((logs["sgd"] - logs["abc"])[kept] @ basis.T) @ basis
    point = np.concatenate([(logs[table] - mean) @ whitening.T for table in tables])
    return TraitModel(theta_h, mean, whitening, point, names * len(tables))


def trait_index(material: str) -> int:
    """Return the index into `TRAITS` of a material of the MERL database."""
    category = categories().get(material, OTHER)
    return TRAITS.index(category if category in TRAITS else OTHER)


def pixel_traits(fits: PixelFits, model: TraitModel | None = None) -> Traits:
    """Return the traits of each pixel.

    Parameters
    ----------
    fits : PixelFits
    model : TraitModel, optional
        That of both tables over the half angles that most pixels saw if not given.
    """
    model = model or trait_model(seen_angles(fits))
    pooled, share = _pooled(fits, model.theta_h)
    posterior = model.posterior(pooled)
    of_trait = share @ posterior
    largest, leading = (np.nan_to_num(a).argmax(axis=1) for a in (share, of_trait))
    return Traits(of_trait, np.where(np.isfinite(of_trait[:, 0]), posterior[largest, leading], np.nan))


def seen_angles(fits: PixelFits) -> Array:
    """Return half angles over the range that most pixels saw, shape (N_ANGLES,), rad."""
    near, far = np.nanmedian(fits.theta_h_range[np.isfinite(fits.normals[:, 0])], axis=0)
    return np.linspace(near, min(far, np.deg2rad(_UNSEEN_DEG)), N_ANGLES)


def _pooled(fits: PixelFits, theta_h: Array) -> tuple[Array, Array]:
    """Return curves that pixels have in common, shape (K, T, C), and each pixel's share of them, (P, K).

    Raises
    ------
    ValueError
        If no pixel is solved.
    """
    if fits.dictionary.name == PALETTE and (leading_material(fits) >= 0).any():
        return _of_palette(fits, theta_h)
    if not np.isfinite(fits.normals[:, 0]).any():
        raise ValueError("no pixel is solved, so that none has a trait")
    group = group_materials(fits)
    n = int(group.max()) + 1
    curves = [_median_curve(fits, np.flatnonzero(group == k), theta_h) for k in range(n)]
    share = np.where(group[:, None] >= 0, group[:, None] == np.arange(n), np.nan).astype(float)
    return np.stack(curves), share


def _of_palette(fits: PixelFits, theta_h: Array) -> tuple[Array, Array]:
    used, n_channels = materials_used(fits), fits.atom.shape[1]
    numbers = np.unique(used[used >= 0])
    cosines = Cosines.on_slice(theta_h)
    atoms = fits.dictionary.atoms
    assert all(atoms[k * n_channels].name == material_name(int(k)) for k in numbers)
    curves = np.stack(
        [np.stack([atoms[k * n_channels + c].evaluate(cosines) for c in range(n_channels)], -1) for k in numbers]
    )
    # A material's scale is the palette's own affair: it counts by the light that comes from it.
    level = np.median(curves, axis=(1, 2))
    light = np.stack([np.where(used == k, fits.coefficient[:, 0], 0.0).sum(axis=1) for k in numbers], axis=-1) * level
    typical = np.array([_typical(light[:, i], light.sum(axis=1)) / level[i] for i in range(len(numbers))])
    total = light.sum(axis=1, keepdims=True)
    share = np.where(total > 0.0, light / np.where(total > 0.0, total, 1.0), np.nan)
    return curves * typical[:, None, None], share


def _typical(light: Array, total: Array) -> float:
    """Return the median of a material's light where most is its own; where it leads nowhere, wherever it has part."""
    leading = light > 0.5 * total
    some = light[leading if leading.any() else light > 0.0]
    return float(np.median(some)) if len(some) else 1.0


def _median_curve(fits: PixelFits, members: NDArray[np.int64], theta_h: Array) -> Array:
    some = members[:: max(len(members) // _MAX_POOLED, 1)]
    angles = np.broadcast_to(theta_h, (len(some), len(theta_h)))
    return np.asarray(np.median(fits.select(some).brdf(Cosines.on_slice(angles)), axis=0))


def _logs(theta_h: Array, curves: Array) -> Array:
    """Return x of curves of shape (K, T, C), flattened, shape (K, T * C)."""
    weighted = curves * np.cos(theta_h)[:, None]
    level = np.median(curves.mean(axis=-1), axis=1)[:, None, None]
    return np.asarray(np.log(np.maximum(weighted, 0.0) + OFFSET * level).reshape(len(curves), -1))


def _inverse_root(differences: Array) -> Array:
    """Return W^(-1/2) of rows of differences, shape (n, D), shrunk towards a sphere, shape (D, D)."""
    W = differences.T @ differences / len(differences)
    W += _SHRINKAGE * np.trace(W) / len(W) * np.eye(len(W))
    value, vector = np.linalg.eigh(W)
    return np.asarray((vector / np.sqrt(value)) @ vector.T)


def _published_curves(table: str, names: Sequence[str], theta_h: Array) -> Array:
    model = {"sgd": sgd, "abc": abc}[table]
    rows = {str(row["name"]): row for row in published(table)}
    cosines = Cosines.on_slice(theta_h)
    return np.stack([model(cosines, rows[name]) for name in names])
