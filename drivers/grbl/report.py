"""Status reports of GRBL 1.1, of which nothing is believed that is not whole."""

from __future__ import annotations

import re
from dataclasses import dataclass

_STATES = "Idle|Run|Hold|Jog|Alarm|Door|Check|Home|Sleep"
_NUMBERS = r"-?\d+\.\d{3}(?:,-?\d+\.\d{3}){2,7}"
_REPORT = re.compile(
    rf"<(?P<state>{_STATES})(?::(?P<part>\d\d?))?\|(?P<kind>[MW])Pos:(?P<position>{_NUMBERS})"
    r"(?P<fields>(?:\|[A-Za-z][A-Za-z0-9]*:[^|<>:]*)*)>"
)
_OFFSET = re.compile(rf"\|WCO:({_NUMBERS})(?=\||$)")
_HOMED = re.compile(r"\|H:([01])(?:,\d+)?(?=\||$)")  # grblHAL's word: 1 = every axis that can be homed is
_FEED_OVERRIDE = re.compile(r"\|Ov:(\d+),\d+,\d+(?=\||$)")


@dataclass(frozen=True, slots=True)
class Report:
    """One status report.

    Attributes
    ----------
    state : str
        ``"Idle"``, ``"Run"``, ``"Hold"``, ``"Jog"``, ``"Alarm"``, ``"Door"``, ``"Check"``, ``"Home"`` or ``"Sleep"``.
    part : int
        Of the state; 0 of a hold = at rest.
    position : tuple of float, shape (n_letters,)
        In the controller's units, of the machine or of the work.
    is_machine : bool
        Of which of the two.
    offset : tuple of float, shape (n_letters,), or None
        From machine to work position; most reports leave it out.
    homed : bool or None
        What grblHAL says of it; None where a report says nothing.
    feed_override : int or None
        Percent; most reports leave it out.
    """

    state: str
    part: int
    position: tuple[float, ...]
    is_machine: bool
    offset: tuple[float, ...] | None
    homed: bool | None
    feed_override: int | None

    @property
    def rests(self) -> bool:
        """Whether no axis moves."""
        moving = {"Hold": (1,), "Door": (2, 3)}.get(self.state, ())
        return self.state not in {"Run", "Jog", "Home"} and self.part not in moving


def parse_report(line: str) -> Report | None:
    """Return the report of a whole line; None for anything else, be it ever so like one."""
    match = _REPORT.fullmatch(line)
    if match is None:
        return None
    position, offset = _numbers(match["position"]), _offset(match["fields"])
    if offset is not None and len(offset) != len(position):
        return None
    homed, override = _HOMED.search(match["fields"]), _FEED_OVERRIDE.search(match["fields"])
    return Report(
        match["state"],
        int(match["part"] or 0),
        position,
        match["kind"] == "M",
        offset,
        None if homed is None else homed[1] == "1",
        None if override is None else int(override[1]),
    )


def machine_position(report: Report, offset: tuple[float, ...] | None) -> tuple[float, ...] | None:
    """Return the machine position of a report.

    Parameters
    ----------
    report : Report
    offset : tuple of float, shape (n_letters,), or None
        The latest that the controller told.

    Returns
    -------
    tuple of float, shape (n_letters,), or None
        None while the offset that it takes is not known.
    """
    if report.is_machine:
        return report.position
    if offset is None or len(offset) != len(report.position):
        return None
    # Rounded to the decimals of the reports, so that the sum has no tail.
    return tuple(round(w + o, 3) for w, o in zip(report.position, offset, strict=True))


def _offset(fields: str) -> tuple[float, ...] | None:
    match = _OFFSET.search(fields)
    return None if match is None else _numbers(match[1])


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(number) for number in text.split(","))
