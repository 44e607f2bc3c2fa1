"""Atoms of a dictionary inside an HDF5 group: models by name, tables with their grids (docs/format.md)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import h5py
import numpy as np

from analysis.reflectance.atoms import MODELS, AnyAtom, Atom, TabulatedAtom, table_problems
from analysis.reflectance.models import Cosines
from instrument.files.untrusted import array_problems, text_problems
from instrument.files.validation import InvalidInputError, Problem, raise_if_any

TABLE = "table"
"""Stands for the model's name where the atom is a table; its parameters are then number of the grid and index."""

TABLE_DATASETS = ("theta_h", "theta_d", "value", "name", "channel")


def write_atoms(group: Any, atoms: Sequence[AnyAtom]) -> None:
    """Write `atoms` as `atom_model`, `atom_parameters` and, for each grid of tables, a group `tables_<g>`.

    Tables are rounded to float32, 6e-8 of each value; their grids stay as they are.
    """
    grids: list[list[TabulatedAtom]] = []
    rows = [_row(atom, grids) for atom in atoms]
    group.create_dataset("atom_model", data=[model for model, _, _ in rows], dtype=h5py.string_dtype())
    group.create_dataset("atom_parameters", data=np.array([(a, b) for _, a, b in rows], float).reshape(-1, 2))
    for number, tables in enumerate(grids):
        write_tables(group.create_group(f"tables_{number}"), tables)


def _row(atom: AnyAtom, grids: list[list[TabulatedAtom]]) -> tuple[str, float, float]:
    """Return model and parameters; a table goes to the tables of its grid in `grids`."""
    if isinstance(atom, Atom):
        return atom.model, atom.a, atom.b
    for number, tables in enumerate(grids):
        if _same_grid(tables[0], atom):
            tables.append(atom)
            return TABLE, number, len(tables) - 1
    grids.append([atom])
    return TABLE, len(grids) - 1, 0


def _same_grid(a: TabulatedAtom, b: TabulatedAtom) -> bool:
    return np.array_equal(a.theta_h, b.theta_h) and np.array_equal(a.theta_d, b.theta_d)


def write_tables(group: Any, tables: Sequence[TabulatedAtom]) -> None:
    """Write tables of one grid into `group`."""
    for name in ("theta_h", "theta_d"):
        group.create_dataset(name, data=getattr(tables[0], name)).attrs["units"] = "rad"
    value = np.stack([table.value for table in tables]).astype(np.float32)
    # By the table, so that one can be read without the others.
    stored = group.create_dataset(
        "value", data=value, chunks=(1, *value.shape[1:]), compression="gzip", compression_opts=4, shuffle=True
    )
    stored.attrs.update({"units": "1/sr", "interpretation": "image"})
    group.create_dataset("name", data=[table.name for table in tables], dtype=h5py.string_dtype())
    group.create_dataset("channel", data=np.array([table.channel for table in tables], np.uint8))


def read_atoms(group: Any) -> tuple[AnyAtom, ...]:
    """Read what `write_atoms` wrote; files without tables are read too.

    Raises
    ------
    InvalidInputError
        With everything that is wrong, by the path of the dataset.
    """
    models, parameters = group["atom_model"].asstr()[...], group["atom_parameters"][...]
    rows = [(model, float(a), float(b)) for model, (a, b) in zip(models, parameters, strict=True)]
    problems = list(_model_problems(group, models))
    grids: dict[int, tuple[TabulatedAtom, ...]] = {}
    for number in sorted({int(a) for model, a, _ in rows if model == TABLE and np.isfinite(a)}):
        try:
            grids[number] = read_tables(group, f"tables_{number}")
        except InvalidInputError as error:
            problems.extend(error.problems)
    problems.extend(_index_problems(group, rows, grids))
    problems.extend(_parameter_problems(group, rows))
    raise_if_any(f"The atoms of {group.name} cannot be used.", problems)
    return tuple(grids[int(a)][int(b)] if model == TABLE else Atom(model, a, b) for model, a, b in rows)


def _model_problems(group: Any, models: Iterable[str]) -> Iterator[Problem]:
    unknown = sorted(set(models) - set(MODELS) - {TABLE})
    if unknown:
        what = f"models {unknown} are not known to this version; known are {sorted([*MODELS, TABLE])}"
        yield Problem(f"{group.name}/atom_model", what)


def _index_problems(
    group: Any, rows: Iterable[tuple[str, float, float]], grids: dict[int, tuple[TabulatedAtom, ...]]
) -> Iterator[Problem]:
    for k, (model, a, b) in enumerate(rows):
        if model == TABLE and np.isfinite([a, b]).all() and int(a) in grids and not 0 <= int(b) < len(grids[int(a)]):
            what = f"atom {k} is table {int(b)} of tables_{int(a)}, which holds {len(grids[int(a)])}"
            yield Problem(f"{group.name}/atom_parameters", what)


def _parameter_problems(group: Any, rows: Iterable[tuple[str, float, float]]) -> Iterator[Problem]:
    for k, (model, a, b) in enumerate(rows):
        if model in MODELS and not _is_brdf(Atom(model, a, b)):
            what = f"atom {k} is {model!r} with {a:g} and {b:g}; its values are not all finite and positive"
            yield Problem(f"{group.name}/atom_parameters", what)


def _is_brdf(atom: Atom) -> bool:
    """Whether an atom has parameters that its model can take."""
    try:
        with np.errstate(all="ignore"):
            values = atom.evaluate(Cosines.on_slice(np.linspace(0.0, 1.5, 7)))
    except (ArithmeticError, ValueError, IndexError):
        return False
    return bool(np.all(np.isfinite(values) & (values >= 0.0)))


def read_tables(parent: Any, name: str) -> tuple[TabulatedAtom, ...]:
    """Read the tables in the group `name` of `parent`.

    Raises
    ------
    InvalidInputError
        With everything that is wrong, by the path of the dataset.
    """
    path = f"{parent.name.rstrip('/')}/{name}"
    title = f"The tables in {path} cannot be used."
    missing = [key for key in TABLE_DATASETS if f"{name}/{key}" not in parent]
    raise_if_any(title, (Problem(f"{path}/{key}", "missing") for key in missing))
    group = parent[name]
    numbers = [key for key in TABLE_DATASETS if key != "name"]
    raise_if_any(title, (problem for key in numbers for problem in array_problems(group[key], f"{path}/{key}")))
    raise_if_any(title, text_problems(group["name"], f"{path}/name"))
    theta_h, theta_d, value = (group[key][...].astype(np.float64) for key in ("theta_h", "theta_d", "value"))
    names, channels = group["name"].asstr()[...], group["channel"][...]
    problems = [Problem(f"{path}/{part}", what) for part, what in table_problems(theta_h, theta_d, value)]
    if value.ndim != 3:
        problems.append(Problem(f"{path}/value", f"has shape {value.shape}; must be (tables, theta_h, theta_d)"))
    problems += [
        Problem(f"{path}/{part}", f"has shape {found.shape}; must be one for each of the {len(value)} tables")
        for part, found in (("name", names), ("channel", channels))
        if value.ndim == 3 and found.shape != (len(value),)
    ]
    raise_if_any(title, problems)
    return tuple(TabulatedAtom(str(names[i]), theta_h, theta_d, value[i], int(channels[i])) for i in range(len(value)))
