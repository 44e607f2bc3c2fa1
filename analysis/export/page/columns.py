"""The reflectances that pixels of a page are sums of: materials of the palette, and the other atoms in use.

Nothing is fitted here. A material is its table over (theta_h, theta_d), any other atom its model and parameters, and
the page evaluates both as `Atom.evaluate` and `TabulatedAtom.evaluate` do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.palette.materials import materials_used
from analysis.pixels.fits import PixelFits
from analysis.reflectance.atoms import AnyAtom, Atom, TabulatedAtom, published
from analysis.reflectance.models import lobe_alpha
from analysis.reflectance.palette import PALETTE

TABLE = "table"

MODEL_CODES = {
    TABLE: 0,
    "lambert": 1,
    "cosine": 2,
    "rim": 3,
    "complement": 4,
    "inverse": 5,
    "inverse_square": 6,
    "roll_off": 7,
    "lobe": 8,
    "sgd": 9,
    "abc": 10,
}
"""Numbers of the models in the page's shader."""

N_PARAMETERS = 12

_SGD = ("rhoD", "rhoS", "alpha", "p", "F0", "F1", "kap", "lambda", "c", "k", "theta0")
_LOGARITHMS = (6, 8)  # kap and c, which 32 bits do not hold once they are raised to powers


@dataclass(frozen=True)
class Columns:
    """N reflectances; the first `n_materials` are the palette's.

    Attributes
    ----------
    n_materials : int
    column_of_atom : ndarray, shape (number of atoms,)
        -1 where no pixel uses an atom.
    header : ndarray of float32, shape (N, 4)
        Number of the model; of a table: its layer, and how many nodes it has over theta_h and theta_d.
    parameters : ndarray of float32, shape (N, N_PARAMETERS)
    nodes : ndarray of float32, shape (2 T, n)
        Of each of T tables sqrt(1 - cos theta_h), then theta_d in rad; the last one repeated.
    tables : ndarray of float32, shape (T, n_d, n_h, 3)
        1/sr.
    """

    n_materials: int
    column_of_atom: NDArray[np.int64]
    header: NDArray[np.float32]
    parameters: NDArray[np.float32]
    nodes: NDArray[np.float32]
    tables: NDArray[np.float32]


def columns_of(fits: PixelFits) -> Columns:
    """Gather the reflectances that pixels are made of.

    Parameters
    ----------
    fits : PixelFits
        Of one channel or of three.
    """
    atoms, n_channels = fits.dictionary.atoms, fits.atom.shape[1]
    # Materials of a file may have any names, those of a palette's too.
    n_materials = int(materials_used(fits).max(initial=-1)) + 1 if fits.dictionary.name == PALETTE else 0
    n_own = n_materials * n_channels
    used = np.unique(fits.atom[fits.atom >= n_own]).astype(np.int64)
    column_of_atom = np.full(len(atoms), -1)
    column_of_atom[:n_own] = np.arange(n_own) // n_channels
    column_of_atom[used] = n_materials + np.arange(len(used))
    groups = [_channels(atoms[k * n_channels : (k + 1) * n_channels]) for k in range(n_materials)]
    groups += [_channels(atoms[k : k + 1]) for k in used]
    tables = [group for group in groups if isinstance(group[0], TabulatedAtom)]
    nodes, values = _tabulated(tables)
    header = np.zeros((len(groups), 4), np.float32)
    parameters = np.zeros((len(groups), N_PARAMETERS), np.float32)
    layer = 0
    for column, (atom, *_) in enumerate(groups):
        if isinstance(atom, TabulatedAtom):
            header[column] = MODEL_CODES[TABLE], layer, len(atom.theta_h), len(atom.theta_d)
            layer += 1
        else:
            header[column, 0] = MODEL_CODES[atom.model]
            values_of = _parameters(atom)
            parameters[column, : len(values_of)] = values_of
    return Columns(n_materials, column_of_atom, header, parameters, nodes, values)


def _channels(atoms: Sequence[AnyAtom]) -> Sequence[AnyAtom]:
    """Return one atom for each of red, green and blue."""
    return atoms if len(atoms) == 3 else (atoms[0],) * 3


def _tabulated(groups: Sequence[Sequence[AnyAtom]]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the nodes and the values of tables, each made as long as the longest."""
    tables = [[atom for atom in group if isinstance(atom, TabulatedAtom)] for group in groups]
    n_h = max((len(table[0].theta_h) for table in tables), default=1)
    n_d = max((len(table[0].theta_d) for table in tables), default=1)
    nodes = np.zeros((2 * max(len(tables), 1), max(n_h, n_d)), np.float32)
    values = np.zeros((max(len(tables), 1), n_d, n_h, 3), np.float32)
    for layer, table in enumerate(tables):
        over_h, over_d = np.sqrt(1.0 - np.cos(table[0].theta_h)), table[0].theta_d
        for row, angles in ((2 * layer, over_h), (2 * layer + 1, over_d)):
            nodes[row] = np.pad(angles, (0, nodes.shape[1] - len(angles)), mode="edge")
        value = np.stack([atom.value for atom in table], axis=-1).transpose(1, 0, 2)
        values[layer, : len(over_d), : len(over_h)] = value
    return nodes, values


def _parameters(atom: AnyAtom) -> Sequence[float]:
    """Return what the shader needs of a model that is not a table."""
    assert isinstance(atom, Atom)
    if atom.model == "lobe":
        return lobe_alpha(atom.a, atom.b), atom.b
    if atom.model == "sgd":
        row, channel = published("sgd")[int(atom.a)], "rgb"[int(atom.b)]
        values = [float(row[f"{name}_{channel}"]) for name in _SGD]
        return [float(np.log(value)) if i in _LOGARITHMS else value for i, value in enumerate(values)]
    if atom.model == "abc":
        row, channel = published("abc")[int(atom.a)], "rgb"[int(atom.b)]
        return [float(row[name]) for name in (f"kD_{channel}", f"A_{channel}", "B", "C", "ior")]
    return atom.a, atom.b
