"""Materials to try a method on, each with a dictionary of the others.

The materials are the published fits of the 100 MERL materials, with the dictionary of the other table and without the
material of that name, since no fit may be its own witness; or, where the files of the database are at hand, the
measured ones, each left out in its turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance import models
from analysis.reflectance.atoms import AnyAtom, published
from analysis.reflectance.categories import categories
from analysis.reflectance.completion import N_ALIKE
from analysis.reflectance.dictionary import Dictionary, from_published
from analysis.reflectance.dictionary_build import build_dictionary
from analysis.reflectance.merl import SCALES, SHAPE, SUFFIX, fill_unmeasured, read_merl
from analysis.reflectance.models import cosines_from_angles
from benchmarks.common.scenes import material_rows
from benchmarks.reproduction.experiment import Request, SkippedError

Array = NDArray[np.float64]

MIN_MATERIALS = N_ALIKE // 3 + 2
"""Of a folder: what one left out leaves must do as a dictionary."""

TABLES = (("sgd", "abc"), ("abc", "sgd"))
"""Pairs of published tables: of the materials, of the dictionary."""


@dataclass(frozen=True, eq=False)
class Angles:
    """Places in an isotropic BRDF.

    Attributes
    ----------
    theta_h, theta_d, phi_d : ndarray, shape (n,)
        Radians.
    """

    theta_h: Array
    theta_d: Array
    phi_d: Array

    @classmethod
    def of(cls, theta_h: Array, theta_d: Array | float = 0.0, phi_d: Array | float = np.pi / 2) -> Angles:
        """Broadcast against each other and flatten."""
        grids = np.broadcast_arrays(np.asarray(theta_h, float), np.asarray(theta_d, float), np.asarray(phi_d, float))
        return cls(*(grid.ravel() for grid in grids))

    @classmethod
    def joined(cls, parts: list[Angles]) -> Angles:
        """Return one after the other."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("theta_h", "theta_d", "phi_d")))

    def __len__(self) -> int:
        return len(self.theta_h)

    @property
    def n_dot_l_and_v(self) -> tuple[Array, Array]:
        """Cosines of light and view, shape (n,) each, negative below the horizon."""
        level = np.cos(self.theta_h) * np.cos(self.theta_d)
        lean = np.sin(self.theta_h) * np.sin(self.theta_d) * np.cos(self.phi_d)
        return level - lean, level + lean


class Brdf(Protocol):
    """An isotropic BRDF of three channels."""

    def at(self, angles: Angles) -> Array:
        """Return its values in 1/sr, shape (n, 3)."""
        ...


@dataclass(frozen=True)
class PublishedBrdf:
    """A row of a published table."""

    table: str
    row: int

    def at(self, angles: Angles) -> Array:
        """Return its values in 1/sr, shape (n, 3)."""
        model = {"sgd": models.sgd, "abc": models.abc}[self.table]
        cosines, _ = cosines_from_angles(angles.theta_h, angles.theta_d, angles.phi_d)
        return model(cosines, published(self.table)[self.row])


@dataclass(frozen=True)
class MeasuredBrdf:
    """A MERL file; a cell that was not measured has the mean over its phi_d, or the nearest such."""

    path: Path

    def at(self, angles: Angles) -> Array:
        """Return its values in 1/sr, shape (n, 3), each of the cell that the place is in."""
        phi = np.mod(angles.phi_d, np.pi)
        parts = np.sqrt(angles.theta_h / (np.pi / 2)), angles.theta_d / (np.pi / 2), phi / np.pi
        # Whole degrees must not fall into the cell below by rounding.
        cells = tuple(np.clip((p * n + 1e-9).astype(int), 0, n - 1) for p, n in zip(parts, SHAPE, strict=True))
        return np.asarray(_filled(self.path)[:, *cells].T)


@lru_cache(maxsize=1)
def _filled(path: Path) -> Array:
    measured = read_merl(path)
    mean, _ = measured.average()
    return np.where(
        measured.measured, measured.stored * SCALES[:, None, None, None], fill_unmeasured(mean)[..., np.newaxis]
    )


@dataclass(frozen=True)
class Material:
    """A material by its name, its category (``"other"`` if unknown) and its BRDF."""

    name: str
    category: str
    brdf: Brdf


@dataclass(frozen=True)
class Collection:
    """Materials to be tested, and those that a dictionary is made of.

    Attributes
    ----------
    source : str
        Where both come from, for people.
    tested, known : tuple of Material
    dictionary : Dictionary
        Three atoms, red, green and blue, for each of `known`, in that order.
    """

    source: str
    tested: tuple[Material, ...]
    known: tuple[Material, ...]
    dictionary: Dictionary

    def trials(self) -> Iterator[tuple[Material, Dictionary]]:
        """Yield each material to be tested with the dictionary of the others."""
        for material in self.tested:
            yield material, self.without(material.name)

    @property
    def is_stand_in(self) -> bool:
        """Whether the dictionary is of other BRDFs than those to be tested, though of the same names."""
        return not set(self.tested) <= set(self.known)

    def without(self, name: str) -> Dictionary:
        """Return the dictionary without the atoms of one material."""
        return Dictionary(f"{self.dictionary.name} without {name}", _others(self.dictionary.atoms, name))


@cache
def _others(atoms: tuple[AnyAtom, ...], name: str) -> tuple[AnyAtom, ...]:
    return tuple(atom for atom in atoms if atom.name != name)


def collections(request: Request, n_tested: int | None = None, always: tuple[str, ...] = ()) -> tuple[Collection, ...]:
    """Return what there is to try, in few collections.

    Parameters
    ----------
    request : Request
        With a folder of measured materials, these; else the published tables, the first pair alone where it is quick.
    n_tested : int or None
        Take about this many materials, evenly over the names; None = all.
    always : tuple of str
        Materials to take as well, where there are such.

    Raises
    ------
    SkippedError
        If the folder holds too few files to be a dictionary.
    """
    if request.merl is not None:
        return (_spread(measured(request.merl), n_tested, always),)
    pairs = TABLES[:1] if request.quick else TABLES
    return tuple(_spread(fitted(*pair), n_tested, always) for pair in pairs)


def fitted(tested: str, known: str) -> Collection:
    """Return the materials of one published table and the dictionary of the other."""
    names = published(tested)["name"]
    return Collection(
        f"materials of {tested.upper()} fits, dictionary of {known.upper()} fits",
        tuple(_fit(tested, str(names[row]), int(row)) for row in material_rows(tested)),
        tuple(_fit(known, str(name), row) for row, name in enumerate(published(known)["name"])),
        from_published(known),
    )


def _fit(table: str, name: str, row: int) -> Material:
    return Material(name, categories().get(name, "other"), PublishedBrdf(table, row))


@lru_cache(maxsize=1)
def measured(folder: Path) -> Collection:
    """Return the materials of a folder of MERL files, which are the dictionary too, with all else of it.

    Raises
    ------
    SkippedError
        If they are too few.
    InvalidInputError
        With all that is wrong with any of them.
    """
    n_files = sum(path.suffix.lower() == SUFFIX for path in folder.iterdir()) if folder.is_dir() else 0
    if n_files < MIN_MATERIALS:
        raise SkippedError(
            f"{folder} holds {n_files} {SUFFIX} files; at least {MIN_MATERIALS} are needed, so that one left out "
            "leaves a dictionary. Name the folder that the whole MERL database was unpacked to."
        )
    tables = build_dictionary(folder)
    materials = tuple(
        Material(m.name, categories().get(m.name, "other"), MeasuredBrdf(folder / m.file))
        for m in tables.materials
        if Path(m.file).suffix.lower() == SUFFIX
    )
    return Collection(f"{n_files} MERL files of {folder.name}", materials, materials, Dictionary("MERL", tables.atoms))


def _spread(collection: Collection, n_tested: int | None, always: tuple[str, ...]) -> Collection:
    n = len(collection.tested)
    if n_tested is None or n_tested >= n:
        return collection
    chosen = set(np.linspace(0, n - 1, n_tested).round().astype(int).tolist())
    tested = tuple(m for i, m in enumerate(collection.tested) if i in chosen or m.name in always)
    return replace(collection, tested=tested)


class Bank:
    """All materials of a collection at named places, so that each is read once.

    Parameters
    ----------
    collection : Collection
    places : dict
        `Angles` by a name.
    """

    def __init__(self, collection: Collection, places: dict[str, Angles]) -> None:
        joined = Angles.joined(list(places.values()))
        ends = np.cumsum([len(angles) for angles in places.values()])
        self._part = {name: slice(end - len(places[name]), end) for name, end in zip(places, ends, strict=True)}
        self._names = np.repeat([material.name for material in collection.known], 3)
        known = {material: material.brdf.at(joined) for material in collection.known}
        self._known = {material.name: value for material, value in known.items()}
        self._tested = {m.name: known[m] if m in known else m.brdf.at(joined) for m in collection.tested}
        self._atoms = np.concatenate([np.empty((len(joined), 0)), *known.values()], axis=1)

    def truth(self, name: str, place: str) -> Array:
        """Return a tested material there, shape (n, 3), 1/sr."""
        return self._tested[name][self._part[place]]

    def other_fit(self, name: str, place: str) -> Array:
        """Return the material of that name that the dictionary has, shape (n, 3), 1/sr."""
        return self._known[name][self._part[place]]

    def atoms(self, place: str, without: str | None = None) -> Array:
        """Return the atoms of the dictionary, less those of one material, shape (n, n_atoms), 1/sr."""
        return self._atoms[self._part[place]][:, self._names != without]
