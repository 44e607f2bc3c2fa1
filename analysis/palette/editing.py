"""Material editing: another material in place of one of the palette's, or more or less of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.palette.materials import materials_used
from analysis.pixels.fits import PixelFits
from analysis.reflectance.atoms import AnyAtom
from analysis.reflectance.dictionary import Dictionary


def swapped(fits: PixelFits, material: int, by: tuple[AnyAtom, ...], scale: float = 1.0) -> PixelFits:
    """Return fits in which a material of the palette is another one.

    Parameters
    ----------
    fits : PixelFits
        With a palette.
    material : int
        Its number in the palette.
    by : tuple of Atom or TabulatedAtom
        The other material, an atom for each channel.
    scale : float
        Units of the fits' BRDF in one of the atoms': 1 where both are in 1/sr.

    Raises
    ------
    ValueError
        If the palette has no such material, or the other has another number of channels.
    """
    n_channels = fits.atom.shape[1]
    _check(fits, material)
    if len(by) != n_channels:
        raise ValueError(f"the material has {len(by)} channels; the scene has {n_channels}")
    atoms = list(fits.dictionary.atoms)
    first = material * n_channels
    # Shares are those of a curve of the palette: how much of that is one of the material is its typical coefficient.
    typical = float(np.median(fits.coefficient[materials_used(fits)[:, None, :].repeat(n_channels, 1) == material]))
    atoms[first : first + n_channels] = by
    of_it = (fits.atom >= first) & (fits.atom < first + n_channels)
    coefficient = np.where(of_it, fits.coefficient * scale / typical, fits.coefficient)
    return replace(fits, dictionary=Dictionary(fits.dictionary.name, tuple(atoms)), coefficient=coefficient)


def reweighted(fits: PixelFits, material: int, factor: float) -> PixelFits:
    """Return fits with `factor` times as much of a material of the palette.

    Raises
    ------
    ValueError
        If the palette has no such material, or the factor is negative.
    """
    _check(fits, material)
    if not factor >= 0.0:
        raise ValueError(f"factor is {factor:g}; it must not be negative")
    of_it = materials_used(fits)[:, None, :] == material
    return replace(fits, coefficient=np.where(of_it, factor * fits.coefficient, fits.coefficient))


def _check(fits: PixelFits, material: int) -> None:
    there = np.unique(materials_used(fits))
    there = there[there >= 0]
    if material not in there:
        listed = ", ".join(map(str, there)) or "none: pixels stand on their own"
        raise ValueError(f"the palette has no material {material}; the scene uses {listed}")
