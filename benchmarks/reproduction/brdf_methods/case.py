"""What a method is given: one material, where its BRDF may be looked up, and a dictionary of other materials."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.dictionary import Dictionary
from benchmarks.reproduction.brdf_domain import LOWEST_ELEVATION_DEG, Domain
from benchmarks.reproduction.brdf_materials import Angles, Bank, Collection, Material

Array = NDArray[np.float64]

DOMAIN, FULL, BIVARIATE, UNIVARIATE = "domain", "full", "bivariate", "univariate"

N_SAMPLES = 100

MAX_DEG = 90.0 - LOWEST_ELEVATION_DEG


@dataclass(frozen=True, eq=False)
class Case:
    """One material to be estimated.

    Attributes
    ----------
    material : Material
    dictionary : Dictionary
        Of the other materials.
    bank : Bank
        With the places `DOMAIN`, `FULL`, `BIVARIATE` and `UNIVARIATE`.
    places : dict of Angles
    domain : Domain
    """

    material: Material
    dictionary: Dictionary
    bank: Bank
    places: dict[str, Angles]
    domain: Domain

    def samples(self, place: str) -> Array:
        """Return what is measured of the material at a place, shape (n, 3), 1/sr."""
        return self.bank.truth(self.material.name, place)

    def atoms(self, place: str) -> Array:
        """Return the atoms of the other materials at a place, shape (n, n_atoms), 1/sr."""
        return self.bank.atoms(place, self.material.name)


Method: TypeAlias = Callable[[Case], Array]
"""From a case to its BRDF at the nodes of the domain, shape (n, 3), 1/sr."""


def cases(collection: Collection, domain: Domain, seed: int) -> Iterator[Case]:
    """Yield the materials of a collection; all are sampled at the same places."""
    places = sampled_places(np.random.default_rng(seed)) | {DOMAIN: domain.angles}
    bank = Bank(collection, places)
    for material, dictionary in collection.trials():
        yield Case(material, dictionary, bank, places, domain)


def sampled_places(rng: np.random.Generator) -> dict[str, Angles]:
    """Return where samples are taken, `N_SAMPLES` at each place.

    Half angles are even, at random or at equal steps, in the square root that MERL's tables are spaced by; the light
    and the view stay as high as the domain has them.
    """
    full = _high(_random(rng, 40 * N_SAMPLES, np.pi * rng.random(40 * N_SAMPLES)))
    bivariate = _high(_random(rng, 40 * N_SAMPLES, np.full(40 * N_SAMPLES, np.pi / 2)))
    return {FULL: full, BIVARIATE: bivariate, UNIVARIATE: slice_places()}


def slice_places(n: int = N_SAMPLES, theta_d: float = 0.0) -> Angles:
    """Return `n` places on the slice of a difference angle (rad), light and view symmetric about the half vector."""
    # n.l = cos theta_h cos theta_d must not fall below that of the largest angle.
    largest = np.arccos(min(np.cos(np.deg2rad(MAX_DEG)) / np.cos(theta_d), 1.0))
    return Angles.of(np.linspace(0.0, np.sqrt(largest), n) ** 2, theta_d)


def _random(rng: np.random.Generator, n: int, phi_d: Array) -> Angles:
    return Angles(np.pi / 2 * rng.random(n) ** 2, np.pi / 2 * rng.random(n), phi_d)


def _high(angles: Angles) -> Angles:
    kept = np.flatnonzero(np.minimum(*angles.n_dot_l_and_v) > np.cos(np.deg2rad(MAX_DEG)))[:N_SAMPLES]
    return Angles(angles.theta_h[kept], angles.theta_d[kept], angles.phi_d[kept])
