"""Response curves: from the counts of a non-linear picture, such as a JPEG, to linear light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instrument.validation import InvalidInputError, Problem, raise_if_any

Array = NDArray[np.float64]

N_LEVELS = 256


@dataclass(frozen=True, slots=True)
class Response:
    """What each count of a picture stands for.

    Attributes
    ----------
    curve : ndarray, shape (n_channels, 256) or (1, 256) for all channels alike
        Linear exposure, relative; 1 is where sRGB has its white.
    sigma : ndarray, same shape
        Relative standard deviation of `curve`; 0 for a curve that was given.
    lowest, highest : int
        Counts between which the curve is known; beyond, it is extrapolated and a pixel not to be believed.
    """

    curve: Array
    sigma: Array
    lowest: int = 1
    highest: int = N_LEVELS - 2

    def linearise(self, counts: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float32]:
        """Return the linear exposure of counts, shape (..., n_channels).

        Raises
        ------
        ValueError
            If a count is beyond the curve, or the channels are not those of the curve.
        """
        if counts.size and counts.max() >= N_LEVELS:
            raise ValueError(f"counts go up to {counts.max()}; a response curve has {N_LEVELS} levels.")
        if len(self.curve) not in (1, counts.shape[-1]):
            raise ValueError(f"counts of {counts.shape[-1]} channels do not fit a curve of {len(self.curve)}.")
        table = self.curve.astype(np.float32)
        if len(table) == 1:
            return np.asarray(table[0][counts])
        return np.stack([line[counts[..., k]] for k, line in enumerate(table)], axis=-1)

    def clipping_level(self) -> Array:
        """Return the linear exposure of `highest`, shape (n_channels,): above it a pixel may have clipped."""
        return self.curve[:, self.highest]


def srgb_response() -> Response:
    """Return the curve of sRGB (IEC 61966-2-1)."""
    return table_response(srgb(np.arange(N_LEVELS)))


def gamma_response(gamma: float) -> Response:
    """Return a power law.

    Raises
    ------
    InvalidInputError
        If the exponent is not between 1 and 4.
    """
    if not 1.0 <= gamma <= 4.0:
        problem = Problem("gamma", f"is {gamma:g}; allowed is 1 (linear) to 4, and 2.2 is usual")
        raise InvalidInputError("The response curve cannot be used.", [problem])
    return table_response((np.arange(N_LEVELS) / (N_LEVELS - 1)) ** gamma)


def table_response(table: Array) -> Response:
    """Return a curve that was given as a table.

    Parameters
    ----------
    table : ndarray, shape (256,) or (n_channels, 256)
        Linear exposure of each count, relative, rising.

    Raises
    ------
    InvalidInputError
        With everything that is wrong with it.
    """
    curve = np.atleast_2d(np.asarray(table, np.float64))
    problems = []
    if curve.shape not in ((1, N_LEVELS), (3, N_LEVELS)):
        problems.append(Problem("response", f"has the shape {curve.shape}; allowed is (256,), (1, 256) or (3, 256)"))
    if not np.isfinite(curve).all() or curve.min(initial=0.0) < 0.0:
        problems.append(Problem("response", "has negative or missing values; exposure is 0 or more"))
    falling = np.flatnonzero((np.diff(curve, axis=-1) < 0.0).any(axis=0))
    if len(falling):
        problems.append(Problem("response", f"falls from count {falling[0]} to {falling[0] + 1}; it must rise"))
    raise_if_any("The response curve cannot be used.", problems)
    return Response(curve, np.zeros_like(curve))


def srgb(z: NDArray[np.int64] | Array) -> Array:
    """Return the linear value of sRGB's counts."""
    x = np.asarray(z, np.float64) / (N_LEVELS - 1)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
