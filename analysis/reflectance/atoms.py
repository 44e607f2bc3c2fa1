"""Atoms of a BRDF dictionary: a model with two parameters, or a table over (theta_h, theta_d)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from io import StringIO
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance import models
from analysis.reflectance.models import Array, Cosines

LAMBERT, DIFFUSE, LOBE, MATERIAL = "lambert", "diffuse", "lobe", "material"
"""Kinds of atom: Lambert's, another without a highlight, a highlight alone, a whole material."""

CHANNEL_NAMES = ("red", "green", "blue")


@dataclass(frozen=True, slots=True)
class Atom:
    """One column of a dictionary: the model's name and its parameters.

    Attributes
    ----------
    model : str
        A key of `MODELS`.
    a, b : float
        The model's parameters (`MODELS`); for a published fit, row of the table and channel.
    """

    model: str
    a: float = 0.0
    b: float = 0.0

    def evaluate(self, cosines: Cosines) -> Array:
        """Return the atom's value in 1/sr, in the shape of `cosines`."""
        return MODELS[self.model](cosines, self.a, self.b)

    @property
    def kind(self) -> str:
        """`LAMBERT`, `DIFFUSE`, `LOBE` or `MATERIAL`."""
        if self.model in PUBLISHED:
            return MATERIAL
        return self.model if self.model in {LAMBERT, LOBE} else DIFFUSE

    @property
    def name(self) -> str:
        """The material of a published fit, which its channels share; else the model."""
        return str(published(self.model)["name"][int(self.a)]) if self.model in PUBLISHED else self.model


@dataclass(frozen=True, eq=False)
class TabulatedAtom:
    """One channel of a material, tabulated over half angle and difference angle.

    Between the nodes it is bilinear in (t = sqrt(1 - cos theta_h), theta_d); beyond the first and the
    last of them it stays constant. Two atoms are equal only if they are the same object, so that a
    dictionary of tables can be hashed.

    Attributes
    ----------
    name : str
        The material, which its channels share.
    theta_h : ndarray, shape (n_h,)
        Radians, ascending, in 0 ... pi / 2.
    theta_d : ndarray, shape (n_d,)
        The same; a single node makes an atom that does not depend on theta_d.
    value : ndarray, shape (n_h, n_d)
        BRDF in 1/sr, finite and not negative.
    channel : int
        Index of the channel.

    Raises
    ------
    ValueError
        If the table is not such.
    """

    name: str
    theta_h: Array
    theta_d: Array
    value: Array
    channel: int = 0

    def __post_init__(self) -> None:
        problems = list(table_problems(self.theta_h, self.theta_d, self.value))
        if problems:
            what = "; ".join(f"{part} {problem}" for part, problem in problems)
            raise ValueError(f"the table of {self.label!r} cannot be used: {what}")

    def evaluate(self, cosines: Cosines) -> Array:
        """Return the atom's value in 1/sr, in the shape of `cosines`."""
        i, u = bracket(np.sqrt(1.0 - cosines.n_dot_h), np.sqrt(1.0 - np.cos(self.theta_h)))
        # The nodes go through the cosine as well, so that rounding near 0 does not miss them.
        j, v = bracket(np.arccos(cosines.cos_d), np.arccos(np.cos(self.theta_d)))
        i_next, j_next = np.minimum(i + 1, len(self.theta_h) - 1), np.minimum(j + 1, len(self.theta_d) - 1)
        low = (1.0 - v) * self.value[i, j] + v * self.value[i, j_next]
        high = (1.0 - v) * self.value[i_next, j] + v * self.value[i_next, j_next]
        return np.asarray((1.0 - u) * low + u * high)

    @property
    def kind(self) -> str:
        """`MATERIAL`."""
        return MATERIAL

    @property
    def label(self) -> str:
        """The material and its channel, for people."""
        channel = CHANNEL_NAMES[self.channel] if self.channel < len(CHANNEL_NAMES) else str(self.channel)
        return f"{self.name} / {channel}"


AnyAtom: TypeAlias = Atom | TabulatedAtom


def table_problems(theta_h: Array, theta_d: Array, value: Array) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with a table, or with several of one grid, as (name of the array, what).

    Parameters
    ----------
    theta_h : ndarray, shape (n_h,)
    theta_d : ndarray, shape (n_d,)
        Radians.
    value : ndarray, shape (..., n_h, n_d)
        1/sr.
    """
    for name, nodes in (("theta_h", theta_h), ("theta_d", theta_d)):
        if nodes.ndim != 1 or nodes.size == 0:
            yield name, f"has shape {nodes.shape}; must be one row of angles"
        elif not np.isfinite(nodes).all() or np.any(np.diff(nodes) <= 0.0):
            yield name, "must be finite and ascending, each angle once"
        elif nodes[0] < 0.0 or nodes[-1] > np.pi / 2 + 1e-6:
            yield name, f"goes from {nodes[0]:.4g} to {nodes[-1]:.4g} rad; must stay within 0 to pi / 2"
    if value.shape[-2:] != (theta_h.size, theta_d.size):
        yield "value", f"has shape {value.shape}; must end in ({theta_h.size}, {theta_d.size}), as theta_h and theta_d"
    n_bad = int(np.count_nonzero(~(np.isfinite(value) & (value >= 0.0))))
    if n_bad:
        yield "value", f"is negative or not finite in {n_bad} of {value.size} cells; a BRDF is neither"


def bracket(x: Array, nodes: Array) -> tuple[NDArray[np.int64], Array]:
    """Return the index of the node below each `x` and how far on to the next it is, 0 ... 1."""
    if len(nodes) == 1:
        return np.zeros(x.shape, np.int64), np.zeros(x.shape)
    i = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2)
    return i, np.clip((x - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0, 1.0)


@cache
def published(name: str) -> NDArray[np.void]:
    """Return the embedded table of published fits of the 100 MERL materials, one structured row each.

    Parameters
    ----------
    name : {"sgd", "abc"}
        [bagher2012] or [low2012].
    """
    text = (files("analysis.reflectance") / "data" / f"merl_{name}.csv").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return np.genfromtxt(StringIO("\n".join(lines)), delimiter=",", names=True, dtype=None, encoding="utf-8")


PUBLISHED = ("sgd", "abc")

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
