"""One check of a calibration: a number against its threshold, and what to do if it fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np


class Status(StrEnum):
    """How a check ended, the worst last."""

    PASS = "PASS"
    WARN = "WARN"
    FAIL = "FAIL"


@dataclass(frozen=True, slots=True)
class Check:
    """One check.

    Attributes
    ----------
    name : str
        What was checked.
    status : Status
    number : str
        What was found, with unit and standard deviation.
    value : float
        What the threshold is compared with; NaN where nothing could be measured.
    threshold : str
        What is allowed.
    remedy : str
        What to do next; empty for a check that passed.
    """

    name: str
    status: Status
    number: str
    value: float
    threshold: str
    remedy: str

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON has it."""
        return {
            "name": self.name,
            "status": self.status.value,
            "number": self.number,
            "value": self.value,
            "threshold": self.threshold,
            "remedy": self.remedy,
        }


@dataclass(frozen=True, slots=True)
class Limits:
    """Largest values that pass and that only warn.

    Attributes
    ----------
    warn, fail : float
        A value above `warn` warns, one above `fail` fails; infinity = never.
    text : str
        The same in words, with the unit.
    """

    warn: float
    fail: float
    text: str

    def status(self, value: float) -> Status:
        """Return how a value ends; NaN, of which nobody knows, warns."""
        if value > self.fail:
            return Status.FAIL
        return Status.PASS if value <= self.warn else Status.WARN


def graded(name: str, value: float, limits: Limits, number: str, remedy: str) -> Check:
    """Return the check of a value; a remedy is for one that does not pass."""
    status = limits.status(value)
    return Check(name, status, number, float(value), limits.text, "" if status is Status.PASS else remedy)


def unknown(name: str, number: str, threshold: str, remedy: str) -> Check:
    """Return a check that could not be made, which warns."""
    return Check(name, Status.WARN, number, float("nan"), threshold, remedy)


def by_severity(checks: Sequence[Check]) -> tuple[Check, ...]:
    """Return the checks, the worst first, otherwise in their order."""
    order = list(Status)
    return tuple(sorted(checks, key=lambda check: -order.index(check.status)))


def count(checks: Sequence[Check], status: Status) -> int:
    """Return how many checks ended so."""
    return sum(check.status is status for check in checks)


def rms(values: Sequence[float]) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
