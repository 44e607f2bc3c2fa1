"""A small result as a demo's: a relief of five materials with mixtures between them, made of tables, nothing fitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.fits import PixelFits
from analysis.reflectance.atoms import TabulatedAtom
from analysis.reflectance.dictionary import Dictionary, parametric
from analysis.reflectance.palette import PALETTE, material_name
from analysis.registration.grid import Grid
from analysis.results.result import Result
from analysis.results.summary import Quantiles, Summary
from tests.analysis.export.gltf_shading import Surface, gltf_brdf
from tests.synthetic import relief

Array = NDArray[np.float64]

SIZE = 40
PITCH = 0.25

PAPER, LACQUER, FELT, GOLD, VARNISH = range(5)

MATERIALS = (
    Surface(color=(0.62, 0.6, 0.55), f0=0.04, roughness=0.55),
    Surface(color=(0.05, 0.35, 0.4), f0=0.05, roughness=0.3),
    Surface(color=(0.3, 0.06, 0.03), f0=0.0, roughness=0.9),
    Surface(color=(0.95, 0.7, 0.35), f0=0.04, roughness=0.45, metallic=1.0),
    Surface(color=(0.05, 0.03, 0.02), f0=0.08, roughness=0.6, coat=1.0, coat_roughness=0.15),
)


def atoms() -> tuple[TabulatedAtom, ...]:
    """Return the five materials as a palette has them: the mean over phi_d of their values."""
    theta_h = np.arccos(1.0 - np.linspace(0.0, 1.0, 160) ** 3)
    theta_d = np.deg2rad(np.linspace(0.0, 88.0, 23))
    h, d, phi = np.meshgrid(theta_h, theta_d, np.deg2rad(np.arange(7.5, 180.0, 15.0)), indexing="ij")
    level, lean = np.cos(h) * np.cos(d), np.sin(h) * np.sin(d) * np.cos(phi)
    light, view = level - lean, level + lean
    above = (light > 0.02) & (view > 0.02)
    made = []
    for k, surface in enumerate(MATERIALS):
        f = gltf_brdf(surface, np.cos(h), np.cos(d), np.maximum(light, 0.02), np.maximum(view, 0.02))
        n_above = np.maximum(above.sum(axis=2), 1)
        for channel in range(3):
            mean = np.sum(np.where(above, f[..., channel], 0.0), axis=2) / n_above
            table = np.where(above.any(axis=2), mean, f[..., channel].mean(axis=2))
            made.append(TabulatedAtom(material_name(k), theta_h, theta_d, table, channel))
    return tuple(made)


def material_map() -> NDArray[np.int64]:
    """Return the material of every pixel: paper with four patches on it, the last column varnish."""
    row, column = np.mgrid[0:SIZE, 0:SIZE]
    material = np.full((SIZE, SIZE), PAPER)
    material[(row < SIZE // 2) & (column >= SIZE // 2)] = LACQUER
    material[(row - 0.75 * SIZE) ** 2 + (column - 0.25 * SIZE) ** 2 < 49] = FELT
    material[(row - 0.25 * SIZE) ** 2 + (column - 0.25 * SIZE) ** 2 < 49] = GOLD
    material[(row > 0.6 * SIZE) & (column > 0.6 * SIZE)] = VARNISH
    return material


def small_result(*, unsolved: tuple[int, ...] = (0, 1, 41), scale: float = 1.0) -> Result:
    """Return the result; the row below the middle mixes paper with lacquer, and one pixel uses other atoms."""
    material = material_map().ravel()
    n = SIZE * SIZE
    coefficient, atom = np.zeros((n, 3, 6)), np.full((n, 3, 6), -1, np.int16)
    atom[:, :, 0] = 3 * material[:, None] + np.arange(3)
    coefficient[:, :, 0] = scale * np.linspace(0.9, 1.1, n)[:, None]
    mixed = np.arange(SIZE * (SIZE // 2), SIZE * (SIZE // 2 + 1))
    atom[mixed, :, 0], atom[mixed, :, 1] = 3 * PAPER + np.arange(3), 3 * LACQUER + np.arange(3)
    share = np.linspace(0.0, 1.0, SIZE)[:, None]
    coefficient[mixed, :, 0], coefficient[mixed, :, 1] = scale * (1.0 - share), scale * share
    own = SIZE * (SIZE - 1)
    atom[own, :, 0], coefficient[own, :, 0] = 15, 0.4 * scale
    grid = Grid(SIZE, SIZE, PITCH)
    points = grid.points()
    z, normals = relief(points[..., 0], points[..., 1])
    normals = normals.reshape(-1, 3)
    normals[list(unsolved)] = np.nan
    depth = z.copy()
    depth.ravel()[list(unsolved)] = np.nan
    covariance = np.full((n, 3), np.deg2rad(0.2) ** 2)
    covariance[:, 1] = 0.0
    covariance[list(unsolved)] = np.nan
    flat = np.ones(n)
    seen = np.broadcast_to(np.deg2rad([1.0, 60.0]), (n, 2)).copy()
    dictionary = Dictionary(PALETTE, (*atoms(), *parametric().atoms))
    fits = PixelFits(normals, covariance, flat, flat, atom, coefficient, np.zeros(n, np.uint8), seen, dictionary)
    sigma = Quantiles(0.2, 0.2, 0.2)
    summary = Summary(
        n_views=40, n_pixels=n, n_unsolved=len(unsolved), theta_h_range_deg=(1.0, 60.0), normal_sigma_deg=sigma,
        relative_error=0.01,
    )  # fmt: skip
    return Result(fits, grid, depth, np.full_like(depth, 0.01), None, (), (), summary)
