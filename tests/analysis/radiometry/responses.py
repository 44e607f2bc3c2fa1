"""Response curves that are known in closed form, to test with."""

from __future__ import annotations

import numpy as np

from analysis.radiometry.response import N_LEVELS, Response, srgb, table_response


def srgb_response() -> Response:
    """Return the curve of sRGB (IEC 61966-2-1)."""
    return table_response(srgb(np.arange(N_LEVELS)))


def gamma_response(gamma: float) -> Response:
    """Return a power law."""
    return table_response((np.arange(N_LEVELS) / (N_LEVELS - 1)) ** gamma)
