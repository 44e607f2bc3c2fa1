"""The materials of the simulated sample: names and numbers; `brdf` holds the formulas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.rendering.brdf import MICROFACET, OREN_NAYAR, ROW_LENGTH, SHIFTED_GAMMA

Triple = tuple[float, float, float]


class Material(Protocol):
    """Something with a name that packs itself into a row of the kernels' table."""

    @property
    def name(self) -> str:
        """Return what people call it."""

    def row(self) -> NDArray[np.float64]:
        """Return kind and parameters, shape (ROW_LENGTH,)."""


def _pack(kind: float, *parameters: float) -> NDArray[np.float64]:
    row = np.zeros(ROW_LENGTH)
    row[: 1 + len(parameters)] = (kind, *parameters)
    return row


@dataclass(frozen=True, slots=True)
class OrenNayar:
    """Matte; `sigma` is the standard deviation of the facets' slope angle in radians, 0 = Lambert."""

    name: str
    albedo: Triple
    sigma: float

    def row(self) -> NDArray[np.float64]:
        """Return kind and parameters, shape (ROW_LENGTH,)."""
        return _pack(OREN_NAYAR, *self.albedo, self.sigma)


@dataclass(frozen=True, slots=True)
class Microfacet:
    """GGX over a diffuse base; `alpha` is the width of the slopes (roughness squared)."""

    name: str
    albedo: Triple
    f0: Triple
    alpha: float

    def row(self) -> NDArray[np.float64]:
        """Return kind and parameters, shape (ROW_LENGTH,)."""
        return _pack(MICROFACET, *self.albedo, *self.f0, self.alpha)


@dataclass(frozen=True, slots=True)
class ShiftedGamma:
    """A fit to a measured material, its 11 parameters per channel in the order of the paper's table."""

    name: str
    parameters: tuple[Triple, ...]

    def row(self) -> NDArray[np.float64]:
        """Return kind and parameters, shape (ROW_LENGTH,)."""
        return _pack(SHIFTED_GAMMA, *(value for triple in self.parameters for value in triple))


TEAL_PAINT = Microfacet("glossy teal paint", (0.04, 0.30, 0.32), (0.045, 0.045, 0.045), 0.12)

GOLD = Microfacet("gold", (0.0, 0.0, 0.0), (0.95, 0.72, 0.32), 0.20)

SATIN_PLASTIC = Microfacet("satin plastic", (0.46, 0.44, 0.52), (0.05, 0.05, 0.05), 0.30)

TERRACOTTA = OrenNayar("matte terracotta", (0.52, 0.25, 0.16), 0.45)

LACQUER = Microfacet("red lacquer", (0.42, 0.05, 0.04), (0.05, 0.05, 0.05), 0.10)

# MERL "red-fabric": row of the supplemental table of Bagher, Soler and Holzschuch, EGSR 2012.
RED_FABRIC = ShiftedGamma(
    "red fabric",
    (
        (0.201899, 0.0279008, 0.0103965),  # rho_d
        (0.168669, 0.0486346, 0.040485),  # rho_s
        (0.324447, 0.228455, 0.109436),  # alpha
        (0.787411, 0.821197, 0.279212),  # p
        (0.0718348, 0.0644687, 0.0206123),  # F0
        (-0.0585917, -0.0062547, -0.050402),  # F1
        (3.88129, 4.32067, 9.16355),  # kappa
        (3.59825, 3.93046, 4.66379),  # lambda
        (0.000130047, 1.04152e-07, 4.59182e-05),  # c
        (13.0776, 19.649, 17.8852),  # k
        (-0.209387, -0.530789, -0.0242035),  # theta_0
    ),
)

WHITE_PAPER = OrenNayar("white plate", (0.85, 0.85, 0.85), 0.0)

INK_ALBEDO = 0.04

BACKGROUND_ALBEDO = 0.02


def table(materials: tuple[Material, ...]) -> NDArray[np.float64]:
    """Return the kernels' table, shape (n_materials, ROW_LENGTH)."""
    return np.stack([material.row() for material in materials])
