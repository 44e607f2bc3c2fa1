"""The dictionary file (`*.dictionary.h5`): measured materials as tables over (theta_h, theta_d) (docs/format.md)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.atom_file import TABLE_DATASETS, read_tables, write_tables
from analysis.reflectance.atoms import TabulatedAtom
from instrument.files.new_hdf5 import BOOKKEEPING_BYTES, new_hdf5
from instrument.files.untrusted import HDF5_ERRORS, array_problems, open_foreign, text_problems
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.files.whole_file import refuse_unreadable, written_whole

SCHEMA = "1.0"

_MATERIALS = ("name", "category", "file", "sha256")

_N_MEASURED = "/entry/tables/n_measured"

_TEXTS = ("/entry/program_version", *(f"/entry/materials/{name}" for name in _MATERIALS))


@dataclass(frozen=True, slots=True)
class Material:
    """Where a material of a dictionary comes from.

    Attributes
    ----------
    name : str
    category : str
        Empty if not stated.
    file, sha256 : str
        Name and digest of the file it was measured in.
    """

    name: str
    category: str
    file: str
    sha256: str


@dataclass(frozen=True, eq=False)
class MaterialTables:
    """Content of a dictionary file.

    Attributes
    ----------
    materials : tuple of Material
    atoms : tuple of TabulatedAtom
        The channels of each material, in the order of `materials`.
    n_measured : ndarray of uint8, shape (n_atoms, n_h, n_d)
        How many phi_d went into each cell; 0 = filled from a neighbour.
    program_version : str
        That wrote the file.
    """

    materials: tuple[Material, ...]
    atoms: tuple[TabulatedAtom, ...]
    n_measured: NDArray[np.uint8]
    program_version: str

    def measured_share(self, name: str) -> float:
        """Return the share of a material's cells that were measured, not filled."""
        ours = [i for i, atom in enumerate(self.atoms) if atom.name == name]
        return float(np.mean(self.n_measured[ours] > 0))


def write_dictionary(path: Path, tables: MaterialTables) -> None:
    """Write a new dictionary file; it appears under its name when it is whole.

    Raises
    ------
    FileExistsError
        If there is a file already.
    InvalidInputError
        If the dictionary could not be read again.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    with written_whole(path) as part:
        with new_hdf5(part, _most_bytes(tables)) as file:
            _write(file, tables)
        refuse_unreadable(path, part, read_dictionary)


def _most_bytes(tables: MaterialTables) -> int:
    # Nothing that is packed takes more than it is, but for the edges of its chunks.
    values = sum(atom.value.nbytes for atom in tables.atoms) + tables.n_measured.nbytes
    # A text of any length takes a page of HDF5's heap at most.
    return int(1.1 * values) + 1000 * (len(tables.atoms) + len(tables.materials)) + 4 * BOOKKEEPING_BYTES


def _write(file: Any, tables: MaterialTables) -> None:
    file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": "halfangle"})
    entry = file.create_group("entry")
    entry.attrs.update({"NX_class": "NXentry", "default": "tables", "halfangle_schema": SCHEMA})
    entry.create_dataset("program_version", data=tables.program_version)
    materials = entry.create_group("materials")
    materials.attrs["NX_class"] = "NXcollection"
    for name in _MATERIALS:
        column = [getattr(material, name) for material in tables.materials]
        materials.create_dataset(name, data=column, dtype=h5py.string_dtype())
    group = entry.create_group("tables")
    group.attrs.update({"NX_class": "NXdata", "signal": "value", "axes": [".", "theta_h", "theta_d"]})
    write_tables(group, tables.atoms)
    counts = group.create_dataset("n_measured", data=tables.n_measured, compression="gzip", shuffle=True)
    counts.attrs["long_name"] = "values of phi_d in the average; 0 = filled from the nearest cell"


def read_dictionary(path: Path) -> MaterialTables:
    """Read a dictionary file.

    Raises
    ------
    InvalidInputError
        With everything that is missing or wrong, by its path in the file.
    """
    title = f"{path} cannot be read as a dictionary."
    needed = [
        *_TEXTS,
        *(f"/entry/tables/{name}" for name in (*TABLE_DATASETS, "n_measured")),
    ]
    try:
        with open_foreign(path, title) as file:
            raise_if_any(title, (Problem(name, "missing") for name in needed if name not in file))
            raise_if_any(title, (problem for name in _TEXTS for problem in text_problems(file.get(name), name)))
            raise_if_any(title, array_problems(file[_N_MEASURED], _N_MEASURED))
            return _read(file)
    except HDF5_ERRORS as error:
        if isinstance(error, InvalidInputError):
            raise InvalidInputError(title, error.problems) from None
        raise InvalidInputError(title, [Problem(str(path), f"not a dictionary file, or damaged ({error})")]) from None


def _read(file: Any) -> MaterialTables:
    entry = file["/entry"]
    columns = [entry[f"materials/{name}"].asstr()[...] for name in _MATERIALS]
    tables = MaterialTables(
        materials=tuple(Material(*(str(text) for text in row)) for row in zip(*columns, strict=True)),
        atoms=read_tables(entry, "tables"),
        n_measured=entry["tables/n_measured"][...],
        program_version=str(entry["program_version"].asstr()[()]),
    )
    raise_if_any("", _agreement_problems(tables))
    return tables


def _agreement_problems(tables: MaterialTables) -> Iterator[Problem]:
    unknown = sorted({atom.name for atom in tables.atoms} ^ {material.name for material in tables.materials})
    if unknown:
        yield Problem("/entry/materials/name", f"does not agree with /entry/tables/name on {', '.join(unknown)}")
    shape = (len(tables.atoms), *tables.atoms[0].value.shape) if tables.atoms else ()
    if tables.n_measured.shape != shape:
        yield Problem("/entry/tables/n_measured", f"has shape {tables.n_measured.shape}; must be {shape}")
