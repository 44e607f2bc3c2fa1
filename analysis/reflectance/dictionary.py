"""Dictionaries of BRDF atoms: parametric (default), the published fits of 100 materials, files of tables.

An atom is a BRDF. The reconstruction needs its curve on the slice theta_d = 0 (`slice_table`), the
renderer its value anywhere (`evaluate`). Curves are tabulated over t = sqrt(1 - cos theta_h), in which
both narrow highlights and grazing angles are smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.atoms import MODELS, PUBLISHED, AnyAtom, Atom, TabulatedAtom, published
from analysis.reflectance.dictionary_file import read_dictionary
from analysis.reflectance.models import Array, Cosines
from instrument.files.validation import InvalidInputError, Problem

__all__ = [
    "MODELS",
    "AnyAtom",
    "Atom",
    "Dictionary",
    "SliceTable",
    "TabulatedAtom",
    "by_name",
    "from_published",
    "lambertian",
    "parametric",
    "published",
]

N_NODES = 1024

# Widths from a near-mirror to a broad sheen; tails from heavier than GGX (gamma = 2) to near-Gaussian.
HALF_WIDTHS_DEG = np.geomspace(0.7, 38.0, 14)

TAIL_GAMMAS = (1.0, 2.0, 6.0)

ROLL_OFFS_DEG = (50.0, 58.0, 66.0, 74.0)

ROLL_OFF_WIDTH_DEG = 5.0


@dataclass(frozen=True)
class Dictionary:
    """An ordered set of atoms.

    Attributes
    ----------
    name : str
        ``"parametric"``, ``"sgd"``, ``"abc"``, or where the atoms come from.
    atoms : tuple of Atom or TabulatedAtom
    """

    name: str
    atoms: tuple[AnyAtom, ...]

    def evaluate(self, cosines: Cosines) -> Array:
        """Return every atom's value in 1/sr, shape (..., n_atoms)."""
        return np.stack([atom.evaluate(cosines) for atom in self.atoms], axis=-1)

    def slice_table(self) -> SliceTable:
        """Tabulate all atoms on the slice theta_d = 0; kept, since every batch of pixels asks for it."""
        return _slice_table(self)


@dataclass(frozen=True, slots=True)
class SliceTable:
    """Atoms and their derivatives on the slice, for linear interpolation in t = sqrt(1 - cos theta_h).

    Attributes
    ----------
    value : ndarray of float32, shape (N_NODES, n_atoms)
        Atoms divided by `scale`.
    derivative : ndarray of float32, shape (N_NODES, n_atoms)
        d value / d cos theta_h.
    scale : ndarray, shape (n_atoms,)
        Root mean square of each atom over the nodes, so that all columns weigh alike.
    """

    value: NDArray[np.float32]
    derivative: NDArray[np.float32]
    scale: Array

    @classmethod
    def from_dictionary(cls, dictionary: Dictionary) -> SliceTable:
        """Tabulate; derivatives by central differences, which the linear interpolation does not outdo."""
        c = 1.0 - np.linspace(0.0, 1.0, N_NODES) ** 2
        value = dictionary.evaluate(Cosines.on_slice(np.arccos(c)))
        scale = np.sqrt(np.mean(value**2, axis=0))
        scale = np.where(scale > 0.0, scale, 1.0)
        value = value / scale
        # Around each node over +- half a node in t: the slope that the interpolation between nodes has.
        derivative = np.gradient(value, c, axis=0)
        return cls(value.astype(np.float32), derivative.astype(np.float32), scale)


@lru_cache(maxsize=8)
def _slice_table(dictionary: Dictionary) -> SliceTable:
    return SliceTable.from_dictionary(dictionary)


@cache
def parametric() -> Dictionary:
    """Return the default dictionary: diffuse, grazing and lobe atoms; needs no measured data."""
    diffuse = [Atom(name) for name in ("lambert", "cosine", "rim", "complement", "inverse", "inverse_square")]
    width = float(np.deg2rad(ROLL_OFF_WIDTH_DEG))
    roll_offs = [Atom("roll_off", float(np.deg2rad(theta)), width) for theta in ROLL_OFFS_DEG]
    lobes = [
        Atom("lobe", float(np.deg2rad(half_width)), gamma) for half_width in HALF_WIDTHS_DEG for gamma in TAIL_GAMMAS
    ]
    return Dictionary("parametric", (*diffuse, *roll_offs, *lobes))


@cache
def lambertian() -> Dictionary:
    """Return the dictionary of one atom, the Lambertian: for light that no other atom was made for."""
    return Dictionary("lambert", (Atom("lambert"),))


@cache
def from_published(name: str) -> Dictionary:
    """Return the dictionary of a published table: each material's three channels as three atoms."""
    n_materials = len(published(name))
    return Dictionary(name, tuple(Atom(name, i, c) for i in range(n_materials) for c in range(3)))


def by_name(name: str) -> Dictionary:
    """Return a dictionary by its name, or from a file.

    Parameters
    ----------
    name : str
        ``"parametric"``, ``"lambert"``, ``"sgd"``, ``"abc"``, or the path of a file
        (`analysis.reflectance.dictionary_file`).

    Raises
    ------
    InvalidInputError
        If there is no such dictionary, or the file cannot be used.
    """
    if name == "parametric":
        return parametric()
    if name == "lambert":
        return lambertian()
    if name in PUBLISHED:
        return from_published(name)
    if Path(name).is_file():
        return Dictionary(Path(name).name, read_dictionary(Path(name)).atoms)
    what = (
        f"is {name!r}, and there is no such file; built in are 'parametric', 'lambert', 'sgd' and 'abc'. "
        "Choose one of these or a file that `halfangle dictionary build` wrote"
    )
    raise InvalidInputError("The dictionary cannot be used.", [Problem("dictionary", what)])
