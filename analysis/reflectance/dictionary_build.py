"""From a folder of measured materials, of MERL or RGL, to a dictionary of tables over (theta_h, theta_d)."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.atoms import CHANNEL_NAMES, TabulatedAtom
from analysis.reflectance.dictionary_file import Material, MaterialTables
from analysis.reflectance.merl import SUFFIX as MERL_SUFFIX
from analysis.reflectance.merl import cell_angles, fill_unmeasured, read_merl
from analysis.reflectance.rgl_file import SUFFIX as RGL_SUFFIX
from analysis.reflectance.rgl_file import read_rgl
from analysis.stages import Track, untracked
from instrument.files.digests import file_digest
from instrument.files.validation import InvalidInputError, Problem, raise_if_any


class MeasuredBrdf(Protocol):
    """What a reader returns."""

    def average(self) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
        """Return means in 1/sr on MERL's grid, NaN where nothing was measured, and how many phi_d each is of."""
        ...


READERS: dict[str, Callable[[Path], MeasuredBrdf]] = {MERL_SUFFIX: read_merl, RGL_SUFFIX: read_rgl}

MANTISSA_BITS = 12
"""How many of the 23 of a float32 are kept: 1.2e-4 of each value, for a file that compresses."""


def build_dictionary(folder: Path, categories: Path | None = None, track: Track = untracked) -> MaterialTables:
    """Average all files of MERL and of the RGL database in a folder over phi_d.

    Parameters
    ----------
    folder : Path
        With `.binary` or `.bsdf` files or both, each named after its material.
    categories : Path or None
        CSV with the columns ``name`` and ``category``; may name more materials than there are.
    track : Track
        Learns how many files are done.

    Raises
    ------
    InvalidInputError
        With all that is wrong with any of the files.
    """
    problems: list[Problem] = []
    category: dict[str, str] = {}
    try:
        category = read_categories(categories) if categories else {}
    except InvalidInputError as error:
        problems.extend(error.problems)
    files = _measured_files(folder)
    problems.extend(_folder_problems(folder, files))
    materials, atoms, counts = [], [], []
    for file in track(files):
        try:
            made, n_measured = _tables(file)
        except InvalidInputError as error:
            problems.extend(error.problems)
            continue
        name = _name(file)
        materials.append(Material(name, category.get(name, ""), file.name, file_digest(file)))
        atoms.extend(made)
        counts.append(n_measured)
    raise_if_any(f"No dictionary can be built from {folder}.", problems)
    return MaterialTables(tuple(materials), tuple(atoms), np.concatenate(counts), version("halfangle"))


def _measured_files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted((f for f in folder.iterdir() if f.suffix.lower() in READERS), key=lambda f: f.name.casefold())


def _name(file: Path) -> str:
    """Return the name of the material; the RGL database adds to it what the file holds."""
    return file.stem.removesuffix("_rgb")


def _folder_problems(folder: Path, files: list[Path]) -> Iterator[Problem]:
    if not folder.is_dir():
        yield Problem(str(folder), "is no folder")
    elif not files:
        what = (
            f"holds no {' and no '.join(READERS)} file; MERL's files are called like alum-bronze{MERL_SUFFIX}, "
            f"those of the RGL database like paper_white_rgb{RGL_SUFFIX}"
        )
        yield Problem(str(folder), what)
    same = defaultdict(list)
    for file in files:
        same[_name(file).casefold()].append(file.name)
    for names in same.values():
        if len(names) > 1:
            yield Problem(
                str(folder), f"{' and '.join(names)} are one material's name but for the case or ending; keep one"
            )


def _tables(file: Path) -> tuple[list[TabulatedAtom], NDArray[np.uint8]]:
    mean, n_measured = READERS[file.suffix.lower()](file).average()
    raise_if_any(f"{file} cannot be averaged.", _average_problems(file, mean))
    value = _rounded(fill_unmeasured(mean))
    theta_h, theta_d, _ = cell_angles()
    return [TabulatedAtom(_name(file), theta_h, theta_d, value[c], c) for c in range(3)], n_measured


def _average_problems(file: Path, mean: NDArray[np.float64]) -> Iterator[Problem]:
    for name, table in zip(CHANNEL_NAMES, mean, strict=True):
        if np.isnan(table).all():
            yield Problem(str(file), f"no cell of {name} rests on measured values alone: fetch the file again")


def _rounded(value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round to `MANTISSA_BITS`, so that the file compresses; no negative values."""
    drop = 23 - MANTISSA_BITS
    bits = value.astype(np.float32).view(np.uint32) + np.uint32(1 << (drop - 1))
    return ((bits >> drop) << drop).view(np.float32).astype(np.float64)


def read_categories(path: Path) -> dict[str, str]:
    """Read the category of each material from a CSV file with the columns ``name`` and ``category``.

    Raises
    ------
    InvalidInputError
        With all that is wrong, by line.
    """
    title = f"{path} cannot be read as a table of categories."
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            missing = sorted({"name", "category"} - set(reader.fieldnames or ()))
            if missing:
                what = f"has no column {' and '.join(missing)}; the first line must read name,category"
                raise InvalidInputError(title, [Problem(f"{path}:1", what)])
            rows = [(reader.line_num, (row["name"] or "").strip(), (row["category"] or "").strip()) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidInputError(title, [Problem(str(path), f"cannot be read ({error})")]) from None
    raise_if_any(title, _row_problems(path, rows))
    return {name: category for _, name, category in rows}


def _row_problems(path: Path, rows: list[tuple[int, str, str]]) -> Iterator[Problem]:
    first: dict[str, int] = {}
    for line, name, _ in rows:
        if not name:
            yield Problem(f"{path}:{line}", "has no name")
        elif name in first:
            yield Problem(f"{path}:{line}", f"{name} stands in line {first[name]} already")
        first.setdefault(name, line)
