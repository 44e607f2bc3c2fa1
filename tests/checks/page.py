"""The page of the acceptance checks: which pitfall each is about, what it measured, and what is allowed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

PITFALLS = {
    1: "a black level that is not the sensor's",
    2: "a clipping level that is not the sensor's; counts shifted in their container",
    3: "pixels that clip in every exposure taken for values",
    4: "pictures with a display's curve taken for linear",
    5: "exposure times and light power that are not what was asked for",
    6: "colours mixed into each other on the way from the mosaic",
    7: "a white balance or brightening that nobody asked for",
    8: "a flat field that holds some of the fall-off with distance",
    9: "a near light and camera taken for far ones",
    10: "a light beside the lens taken to be in it",
    11: "boards that are not as stated",
    12: "relief mirrored or inside out",
    13: "half a pixel, and parallax",
    14: "lengths in another unit",
    15: "BRDFs in another unit",
    16: "files of the MERL format misread",
    17: "depth upside down, on pixels of the wrong shape, or bent by holes",
    18: "gross shape that drifts away from the boards' plane",
    19: "half angles that nobody saw",
    20: "values that are no numbers, for no reason",
}

HEAD = """# Acceptance checks

The pitfalls of the way from counts to normals and reflectance, each with a test that measures how far we are from
it, against a formula, another implementation or the simulated rig's truth. `make checks` runs the tests and writes
this page when all of them have passed; it is not edited by hand.

| # | pitfall | measured | value | allowed | test |
|---|---|---|---|---|---|
"""


@dataclass(frozen=True, slots=True)
class Measurement:
    """One line of the page.

    Attributes
    ----------
    number : int
        Of the pitfall.
    what, value, limit : str
        As they are shown.
    file, test : str
        The test, and its file from the repository's root.
    """

    number: int
    what: str
    value: str
    limit: str
    file: str
    test: str


def missing(measured: Sequence[Measurement]) -> list[int]:
    """Return the pitfalls that nothing was measured about."""
    return sorted(set(PITFALLS) - {m.number for m in measured})


def page(measured: Sequence[Measurement], pitfalls: Mapping[int, str] = PITFALLS) -> str:
    """Return the page: the pitfalls in order, the measurements of each as they were taken."""
    lines, last = [], 0
    for m in sorted(measured, key=lambda m: m.number):
        first = (str(m.number), pitfalls[m.number]) if m.number != last else ("", "")
        lines.append("| " + " | ".join((*first, m.what, m.value, m.limit, f"[{m.test}](../{m.file})")) + " |")
        last = m.number
    return HEAD + "\n".join(lines) + "\n"


def shown(value: float, limit: float) -> str:
    """Return two digits of a value; one that is nothing beside its limit is shown as that, whatever it is."""
    if 0.0 < abs(value) < 1e-3 * abs(limit):
        return f"< {1e-3 * abs(limit):g}"
    rounded = float(f"{value:.2g}")
    return f"{rounded:g}"
