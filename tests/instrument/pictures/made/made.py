"""A file that has been made, and the light that its writer meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


@dataclass(frozen=True)
class Made:
    """A file.

    Attributes
    ----------
    path : Path
    header : dict
        What was chosen for it, to be shown when something is wrong.
    light : ndarray or None
        Values proportional to light, as reading has to give them; None if no reading can be right.
    step : float or ndarray
        By how much reading may be off: the rounding of the file's type.
    must_read : bool
        Whether it may not be refused: what is plain has to be read.
    curve : bool
        Whether its header says that values are not proportional to light.
    black : ndarray, shape (2, 2), or None
        Level of darkness at each place of a mosaic's cell, which `light` does not include.
    white : float or None
        Count at which the sensor clips.
    pattern : str or None
        Colours of the cell.
    """

    path: Path
    header: dict[str, Any]
    light: Array | None
    step: Any = 0.0
    must_read: bool = True
    curve: bool = False
    black: Array | None = None
    white: float | None = None
    pattern: str | None = None


@dataclass
class Chooser:
    """Chooses by a seeded generator and remembers what it chose."""

    rng: np.random.Generator
    header: dict[str, Any] = field(default_factory=dict)

    def one(self, name: str, choices: Sequence[Any], usual: float = 0.0) -> Any:
        """Return one of `choices`; the first of them with a probability of at least `usual`."""
        first = self.rng.random() < usual
        self.header[name] = chosen = choices[0 if first else int(self.rng.integers(len(choices)))]
        return chosen

    def yes(self, name: str, share: float) -> bool:
        """Return True in so many cases."""
        chosen = bool(self.rng.random() < share)
        if chosen:
            self.header[name] = True
        return chosen

    def size(self, least: int = 3, most: int = 20) -> tuple[int, int]:
        """Return height and width."""
        height, width = (int(n) for n in self.rng.integers(least, most, 2))
        self.header["size"] = (height, width)
        return height, width

    def values(self, dtype: Any, shape: tuple[int, ...]) -> Array:
        """Return values over all that a type holds, or of a wide range of floating-point numbers."""
        kind = np.dtype(dtype)
        if kind.kind in "iu":
            limits = np.iinfo(kind)
            return self.rng.integers(limits.min, limits.max, shape, dtype=kind, endpoint=True)
        if kind.kind == "b":
            return self.rng.integers(0, 2, shape).astype(np.bool_)
        values = 10.0 ** self.rng.uniform(-2, 3, shape)
        return values.astype(kind)


def icc_profile(gamma: float) -> bytes:
    """Return a colour profile whose curves are powers; its other parts are left out."""
    curve = b"curv" + bytes(4) + (1).to_bytes(4) + round(gamma * 256).to_bytes(2) + bytes(2)
    names = (b"rTRC", b"gTRC", b"bTRC", b"kTRC")
    start = 132 + 12 * len(names)
    entries = b"".join(name + start.to_bytes(4) + len(curve).to_bytes(4) for name in names)
    # What no program packs away: one that is small when packed is taken for damaged.
    body = len(names).to_bytes(4) + entries + curve + bytes(range(256))
    d50 = bytes.fromhex("0000f6d6 00010000 0000d32d")
    colours = b"mntrRGB XYZ ".rjust(24, b"\0") + bytes(12)
    head = (128 + len(body)).to_bytes(4) + colours[4:] + b"acsp" + bytes(28) + d50 + bytes(48)
    return head + body
