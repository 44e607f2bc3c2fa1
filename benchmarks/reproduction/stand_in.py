"""What a verdict may say where fits stand in for the measured materials.

Two published fits of one material, each made from all its measurements, are themselves far apart for glossy materials.
So where a claim of likeness does not hold on the stand-in, the other table's fit of the very same material is put to
the same test: if that fails too, the stand-in is too rough for the claim, whatever the method.
"""

from __future__ import annotations

from benchmarks.reproduction.experiment import Verdict


def likeness(ours: float, other_fit: float | None) -> Verdict:
    """Judge a claim that holds if it holds for most.

    Parameters
    ----------
    ours : float
        Share of the cases in which it holds.
    other_fit : float or None
        The same for the other published fit of each material; None = the materials are measured.
    """
    if ours > 0.5:
        return Verdict.EQUAL
    if other_fit is not None and other_fit <= 0.5:
        return Verdict.NOT_COMPARABLE
    return Verdict.WORSE


def worst(verdicts: list[Verdict]) -> Verdict:
    """Return the least favourable of several verdicts."""
    order = (Verdict.WORSE, Verdict.NOT_COMPARABLE, Verdict.EQUAL, Verdict.BETTER)
    return min(verdicts, key=order.index)
