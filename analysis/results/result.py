"""A result as a value: maps, the BRDF of every pixel in a basis, choices and figures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.pixels import samples
from analysis.pixels.fits import PixelFits
from analysis.reconstruction.choices import Choice
from analysis.reconstruction.reconstruction import Reconstruction
from analysis.reflectance.atoms import LAMBERT, LOBE, MATERIAL
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette_completion import MaterialBrdfs
from analysis.registration.grid import Grid
from analysis.results.summary import Summary, plain
from analysis.results.views import FittedViews
from analysis.stages import Stage

Array = NDArray[np.float64]

Scalar = TypeVar("Scalar", bound=np.generic)

MODEL_NAMES = ("unsolved", "lambert", "diffuse", "one lobe", "mixture", "material", "mixture of materials")

FLAG_NAMES = {
    samples.TOO_FEW_VIEWS: "too few views",
    samples.BLACK: "too dark to tell a normal",
    samples.CLIPPED: "clipped in some view",
    samples.NOT_CONVERGED: "not converged",
    samples.POOR_FIT: "poor fit",
}

DIFFUSE_REFERENCE_DEG = 45.0
"""Half angle at which the curve stands for the diffuse albedo: beyond most lobes, short of the grazing atoms.
A pixel that was not seen so far out is read at the largest half angle it was seen at."""


@dataclass(frozen=True)
class Result:
    """A result file's content.

    Attributes
    ----------
    fits : PixelFits
        Of the H * W pixels in reading order.
    grid : Grid
    depth, depth_sigma : ndarray, shape (H, W)
        Millimetres; NaN where unknown.
    truth_error : ndarray, shape (H, W), or None
        Angular error in degrees where the stack held a truth.
    choices : tuple of Choice
        What was modelled, and why.
    stages : tuple of Stage
        What the reconstruction took.
    summary : Summary
    materials : MaterialBrdfs or None
        The palette's materials over all angles, with their band, where a palette was used.
    views : FittedViews or None
        None in files of version 1.1 and before.
    """

    fits: PixelFits
    grid: Grid
    depth: Array
    depth_sigma: Array
    truth_error: Array | None
    choices: tuple[Choice, ...]
    stages: tuple[Stage, ...]
    summary: Summary
    materials: MaterialBrdfs | None = None
    views: FittedViews | None = None

    def figures(self) -> dict[str, Any]:
        """Return all figures for JSON: the summary, the stages and the choices."""
        return {**self.summary.as_dict(), "stages": plain(self.stages), "choices": plain(self.choices)}

    def as_map(self, values: NDArray[Scalar]) -> NDArray[Scalar]:
        """Give per-pixel values the shape of the area."""
        return values.reshape(self.grid.height, self.grid.width, *values.shape[1:])

    @property
    def normals(self) -> Array:
        """Unit normals, shape (H, W, 3)."""
        return self.as_map(self.fits.normals)

    def render(self, camera: Array, light: Array, light_power: float = 1.0) -> Array:
        """Predict the radiance of the area on its own grid, shape (H, W, C), in the stack's units.

        Parameters
        ----------
        camera, light : ndarray, shape (3,)
            Sample frame, mm.
        light_power : float
            As the stack's.
        """
        points = self.grid.points(np.nan_to_num(self.depth)).reshape(-1, 3)
        return self.as_map(self.fits.radiance(points, camera, light, light_power))


def diffuse_albedo(fits: PixelFits) -> Array:
    """Return pi f at `DIFFUSE_REFERENCE_DEG` or the largest half angle seen: the albedo of a Lambertian alike there.

    Returns
    -------
    ndarray, shape (P, C)
    """
    solved = np.isfinite(fits.normals[:, 0])
    angle = np.where(solved, np.minimum(fits.theta_h_range[:, 1], np.deg2rad(DIFFUSE_REFERENCE_DEG)), 0.0)
    albedo = np.pi * fits.brdf(Cosines.on_slice(angle))
    albedo[~solved] = np.nan
    return albedo


def model_used(fits: PixelFits) -> NDArray[np.uint8]:
    """Return which model each pixel came to, an index into `MODEL_NAMES`, shape (P,).

    Where a pixel uses materials, they name its model; atoms of another kind may stand beside them.
    """
    atoms = fits.dictionary.atoms
    kind = np.array([{LAMBERT: 1, LOBE: 3, MATERIAL: 5}.get(atom.kind, 2) for atom in atoms])
    kinds = np.where(fits.atom >= 0, kind[np.maximum(fits.atom, 0)], 0)
    numbers = {name: i for i, name in enumerate(dict.fromkeys(atom.name for atom in atoms))}
    # The channels of a material are atoms of one name.
    name = np.array([numbers[atom.name] for atom in atoms])[np.maximum(fits.atom, 0)]
    n_lobes = _count_distinct(np.where(kinds == 3, fits.atom, -1))
    n_materials = _count_distinct(np.where(kinds == 5, name, -1))
    model = np.where(n_lobes > 1, 4, np.where(n_lobes == 1, 3, np.where((kinds == 2).any(axis=(1, 2)), 2, 1)))
    model = np.where(n_materials > 1, 6, np.where(n_materials == 1, 5, model))
    return np.where(np.isfinite(fits.normals[:, 0]), model, 0).astype(np.uint8)


def _count_distinct(atoms: NDArray[np.integer[Any]]) -> NDArray[np.int64]:
    """Count the distinct non-negative values in each row."""
    ordered = np.sort(atoms.reshape(len(atoms), -1), axis=1)
    new = np.diff(ordered, axis=1, prepend=-1) != 0
    return np.asarray(np.sum(new & (ordered >= 0), axis=1))


def result_of(
    reconstruction: Reconstruction, stages: Iterable[Stage], summary: Summary, truth_error: Array | None
) -> Result:
    """Gather a reconstruction and what is known about it."""
    return Result(
        fits=reconstruction.fits,
        grid=reconstruction.stack.grid,
        depth=reconstruction.depth,
        depth_sigma=reconstruction.depth_sigma,
        truth_error=truth_error,
        choices=tuple(reconstruction.choices),
        stages=tuple(stages),
        summary=summary,
        materials=reconstruction.materials,
        views=FittedViews.of(reconstruction),
    )
