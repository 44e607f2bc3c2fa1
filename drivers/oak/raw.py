"""From the bytes of a raw frame to counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError

# Bits -> samples of a group, and the bytes that it fills: their high bytes first, then one byte of the low bits of all
# of them, of the first one lowest (MIPI CSI-2, RAW10 and RAW12).
_GROUPS = {10: (4, 5), 12: (2, 3)}


def counts_from_bytes(
    data: NDArray[np.uint8], height: int, width: int, row_bytes: int, bit_depth: int
) -> NDArray[np.uint16]:
    """Return counts, right-aligned.

    Whether samples are packed follows from the length of a row.

    Parameters
    ----------
    data : ndarray of uint8, shape (n_bytes,)
        Rows one after the other; what is behind the last one is ignored.
    height, width : int
        Pixels.
    row_bytes : int
        From the start of a row to the start of the next.
    bit_depth : int
        Bits of a count.

    Returns
    -------
    ndarray of uint16, shape (height, width)

    Raises
    ------
    DeviceError
        If the rows are too short, or a count has more bits than `bit_depth`.
    """
    if data.size < height * row_bytes:
        raise DeviceError(
            f"a frame has {data.size} bytes and should have {height * row_bytes}. Take it again; if it stays so, look "
            "at the cable"
        )
    rows = data[: height * row_bytes].reshape(height, row_bytes)
    if bit_depth == 8 and row_bytes >= width:
        return rows[:, :width].astype(np.uint16)
    if row_bytes >= 2 * width:
        return _words(rows[:, : 2 * width], bit_depth)
    return _unpacked(rows, width, bit_depth)


def _words(rows: NDArray[np.uint8], bit_depth: int) -> NDArray[np.uint16]:
    counts = np.ascontiguousarray(rows).view("<u2").astype(np.uint16)
    highest = int(counts.max(initial=0))
    if highest >> bit_depth:
        raise DeviceError(
            f"a frame has counts up to {highest}; {bit_depth} bits hold {2**bit_depth - 1}. Correct bit_depth: 16, "
            "where the counts are aligned to the left"
        )
    return counts


def _unpacked(rows: NDArray[np.uint8], width: int, bit_depth: int) -> NDArray[np.uint16]:
    n_samples, n_bytes = _GROUPS.get(bit_depth, (1, 2))
    needed = -(-width // n_samples) * n_bytes
    if bit_depth not in _GROUPS or rows.shape[1] < needed:
        raise DeviceError(
            f"a row of {width} pixels has {rows.shape[1]} bytes; {bit_depth} bits need {2 * width}"
            f"{f', or {needed} packed' if bit_depth in _GROUPS else ''}. Correct bit_depth"
        )
    groups = rows[:, :needed].reshape(rows.shape[0], -1, n_bytes).astype(np.uint16)
    n_low = bit_depth - 8
    shifts = n_low * np.arange(n_samples, dtype=np.uint16)
    low = groups[:, :, -1:] >> shifts & np.uint16((1 << n_low) - 1)
    counts: NDArray[np.uint16] = (groups[:, :, :n_samples] << n_low | low).astype(np.uint16, copy=False)
    return counts.reshape(rows.shape[0], -1)[:, :width]
