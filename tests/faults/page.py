"""The page of the faults: how each is injected, what became of the capture, and how long the light shone on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

FAULTS = {
    1: "camera unplugged during a bracket",
    2: "a frame never arrives",
    3: "a frame is dropped",
    4: "a frame comes twice or out of order",
    5: "a frame of the exposure before",
    6: "a frame that is torn, short or of the wrong shape",
    7: "every exposure clips",
    8: "all black: lens cap or dead light",
    9: "the light does not come on",
    10: "the light does not go off",
    11: "the light drifts or is cold",
    12: "the stage stalls",
    13: "the stage raises an alarm or hits a limit",
    14: "garbage or half a line on the wire",
    15: "the port is gone, or there is no permission",
    16: "kill -9 at any time",
    17: "power loss while writing",
    18: "the disk is full",
    19: "the disk is slow or stalls",
    20: "Ctrl-C: once, twice, during clean-up",
    21: "an exception in a user's callback",
    22: "the wall clock jumps",
    23: "two processes open one rig or one file",
    24: "a malformed rig, protocol or plan",
    25: "a truncated, corrupted or foreign session",
    26: "a device swapped, a calibration that is old, a sample that was moved",
}

HEAD = """# Faults that a capture survives

Each of the faults that a capture must survive, injected into the simulated rig or the operating system by a test that
states what must become of it. In every case the light ends dark or the program says loudly that it is not, the session
verifies, and where it can be resumed it ends with the frames of an uninterrupted one. `make faults` runs the tests and
writes this page when all have passed; it is not edited by hand. The scripts of `--faults` take the effects named here
([examples/faults.toml](../examples/faults.toml)). "Light on" is how long the light shone after the fault, in seconds of
the rig's clock or, where the fault is of the computer, of the wall's; a dash means that it was dark already.

| # | fault | injected | what happened | light on, s | test |
|---|---|---|---|---|---|
"""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the page.

    Attributes
    ----------
    number : int
        Of the fault.
    injected, happened, light : str
        As they are shown.
    file, test : str
        The test, and its file from the repository's root.
    """

    number: int
    injected: str
    happened: str
    light: str
    file: str
    test: str


def missing(rows: Sequence[Row]) -> list[int]:
    """Return the faults that no test showed."""
    return sorted(set(FAULTS) - {row.number for row in rows})


def page(rows: Sequence[Row]) -> str:
    """Return the page: the faults in order, the rows of each as they were taken."""
    lines, last = [], 0
    for row in sorted(rows, key=lambda row: row.number):
        first = (str(row.number), FAULTS[row.number]) if row.number != last else ("", "")
        cells = (*first, row.injected, row.happened, row.light, f"[{row.test}](../{row.file})")
        lines.append("| " + " | ".join(cells) + " |")
        last = row.number
    return HEAD + "\n".join(lines) + "\n"
