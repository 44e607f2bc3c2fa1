"""Arrays as text within a page: planes of bytes, of maps their differences along rows, deflated, base64."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_LEVEL = 9


def pack(arrays: Mapping[str, NDArray[Any]]) -> tuple[list[dict[str, Any]], str]:
    """Pack arrays of shape (rows, columns, planes).

    Each plane gives as many planes of bytes as its numbers have bytes, the lowest first. A byte of a map is its
    difference to the one before it in its row, modulo 256, so that smooth maps become runs of small numbers; lists,
    which have one row, stay as they are.

    Returns
    -------
    index : list of dict
        Name, kind and shape of each, and whether it is kept as differences, in the order in which they follow.
    text : str
    """
    index, parts = [], []
    for name, array in arrays.items():
        rows, columns, planes = array.shape
        is_map = rows > 1
        index.append({"name": name, "kind": array.dtype.name, "shape": [rows, columns, planes], "differences": is_map})
        whole = np.ascontiguousarray(array.transpose(2, 0, 1), array.dtype.newbyteorder("<"))
        of_bytes = whole.view(np.uint8).reshape(planes, rows, columns, array.dtype.itemsize).transpose(0, 3, 1, 2)
        parts.append((np.diff(of_bytes, axis=-1, prepend=np.uint8(0)) if is_map else of_bytes).tobytes())
    return index, base64.b64encode(zlib.compress(b"".join(parts), _LEVEL)).decode("ascii")
