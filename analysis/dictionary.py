"""Dictionaries of BRDF atoms: the parametric one (default) and the published fits of 100 materials.

An atom is a BRDF. The reconstruction needs its curve on the slice theta_d = 0 (`slice_table`), the
renderer its value anywhere (`evaluate`). Curves are tabulated over t = sqrt(1 - cos theta_h), in which
both narrow highlights and grazing angles are smooth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from io import StringIO

import numpy as np
from numpy.typing import NDArray

from analysis import reflectance as models
from analysis.reflectance import Array, Cosines

N_NODES = 1024
# Widths from a near-mirror to a broad sheen; tails from heavier than GGX (gamma = 2) to near-Gaussian.
HALF_WIDTHS_DEG = np.geomspace(0.7, 38.0, 14)
TAIL_GAMMAS = (1.0, 2.0, 6.0)
ROLL_OFFS_DEG = (50.0, 58.0, 66.0, 74.0)
ROLL_OFF_WIDTH_DEG = 5.0


@dataclass(frozen=True, slots=True)
class Atom:
    """One column of a dictionary: the model's name and its parameters.

    Attributes
    ----------
    model : str
        A key of `MODELS`, or ``"sgd"`` or ``"abc"``.
    a, b : float
        The model's parameters (`MODELS`); for a published fit, row of the table and channel.
    """

    model: str
    a: float = 0.0
    b: float = 0.0


@cache
def published(name: str) -> NDArray[np.void]:
    """Return the embedded table of published fits of the 100 MERL materials, one structured row each.

    Parameters
    ----------
    name : {"sgd", "abc"}
        [bagher2012] or [low2012].
    """
    text = (files("analysis") / "data" / f"merl_{name}.csv").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return np.genfromtxt(StringIO("\n".join(lines)), delimiter=",", names=True, dtype=None, encoding="utf-8")


# model -> f(cosines, a, b). Each is reciprocal: the light and the view direction enter alike.
MODELS: dict[str, Callable[[Cosines, float, float], Array]] = {
    "lambert": lambda q, a, b: np.full_like(q.n_dot_h, 1.0 / np.pi),
    "cosine": lambda q, a, b: q.n_dot_h / np.pi,
    "rim": lambda q, a, b: (1.0 - q.n_dot_h) ** 5 / np.pi,
    "complement": lambda q, a, b: (1.0 - q.n_dot_h) / np.pi,
    "inverse": lambda q, a, b: (q.n_dot_l * q.n_dot_v) ** -0.5 / np.pi,
    "inverse_square": lambda q, a, b: (q.n_dot_l * q.n_dot_v) ** -1.0 / np.pi,
    "roll_off": models.roll_off,
    "lobe": models.lobe,
    "sgd": lambda q, a, b: np.asarray(models.sgd(q, published("sgd")[int(a)])[..., int(b)]),
    "abc": lambda q, a, b: np.asarray(models.abc(q, published("abc")[int(a)])[..., int(b)]),
}


@dataclass(frozen=True)
class Dictionary:
    """An ordered set of atoms.

    Attributes
    ----------
    name : str
        ``"parametric"``, ``"sgd"`` or ``"abc"``.
    atoms : tuple of Atom
    """

    name: str
    atoms: tuple[Atom, ...]

    def evaluate(self, cosines: Cosines) -> Array:
        """Return every atom's value in 1/sr, shape (..., n_atoms)."""
        return np.stack([MODELS[atom.model](cosines, atom.a, atom.b) for atom in self.atoms], axis=-1)

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
def from_published(name: str) -> Dictionary:
    """Return the dictionary of a published table: each material's three channels as three atoms."""
    n_materials = len(published(name))
    return Dictionary(name, tuple(Atom(name, i, c) for i in range(n_materials) for c in range(3)))


def by_name(name: str) -> Dictionary:
    """Return a dictionary by its name.

    Raises
    ------
    ValueError
        If there is no such dictionary.
    """
    if name == "parametric":
        return parametric()
    if name in {"sgd", "abc"}:
        return from_published(name)
    raise ValueError(f"dictionary is {name!r}; built in are 'parametric', 'sgd' and 'abc'. Choose one of these.")
