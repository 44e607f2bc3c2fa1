"""Prints a quick look for the terminal."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.quick_look.quick_look import QuickLook


def quick_look_lines(look: QuickLook) -> Iterator[str]:
    """Yield what a quick look says of the normals and of the half angles that lack views, a line each."""
    yield from _normals(look)
    if look.dark:
        yield f"  left out   poses {', '.join(map(str, look.dark))}, whose pictures are black"
    if look.coverage is not None:
        for text in look.coverage.advice() or ("no half angle lacks views",):
            yield f"  coverage   {text}"


def _normals(look: QuickLook) -> list[str]:
    if look.problems:
        return [f"  normals    none yet: {what}" for what in look.problems]
    n_solved = np.count_nonzero(np.isfinite(look.sigma_deg))
    return [
        f"  normals    of {n_solved} cells of {look.pitch:.2g} mm: {look.median_sigma_deg:.1f} deg by the scatter "
        "of the views; nominal places add two or more"
    ]
