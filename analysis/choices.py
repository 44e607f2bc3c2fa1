"""What was modelled, and why: every optional effect is a choice made from evidence, or forced."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True)
class Choice:
    """One effect that could be modelled or not.

    Attributes
    ----------
    effect : str
        E.g. ``"parallax"``.
    chosen : str
        E.g. ``"on"``.
    reason : str
        The evidence with its numbers, or ``"forced by option"``.
    """

    effect: str
    chosen: str
    reason: str

    def as_dict(self) -> dict[str, str]:
        """Return the choice as plain text for files."""
        return asdict(self)
