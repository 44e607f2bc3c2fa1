"""What has to be configured of a session before it can be calibrated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instrument.files.validation import Problem, raise_if_any
from instrument.session.session import Session


@dataclass(frozen=True, slots=True)
class Nominal:
    """Nominal values of a session.

    Attributes
    ----------
    area_mm : tuple of float
        Width and height of the area.
    light_offset_mm, light_offset_sigma_mm : ndarray, shape (3,)
        Of the light from the lens in the camera frame, and its standard deviation.
    """

    area_mm: tuple[float, float]
    light_offset_mm: NDArray[np.float64]
    light_offset_sigma_mm: NDArray[np.float64]


def nominal_setup(session: Session) -> Nominal:
    """Return the nominal values of a session.

    Raises
    ------
    InvalidInputError
        With everything that an import left out and how to state it.
    """
    raise_if_any(f"{session.path} cannot be calibrated.", _missing(session))
    area, offset, sigma = (
        session.nominal.area_mm,
        session.nominal.light_offset_mm,
        session.nominal.light_offset_sigma_mm,
    )
    assert area is not None
    assert offset is not None
    assert sigma is not None
    return Nominal(area, offset, sigma)


def _missing(session: Session) -> Iterator[Problem]:
    needed = {
        "area_mm": (session.nominal.area_mm, "state [area] width_mm and height_mm"),
        "light_offset_mm": (session.nominal.light_offset_mm, "state [light] offset_mm"),
        "light_offset_sigma_mm": (session.nominal.light_offset_sigma_mm, "state [light] offset_sigma_mm"),
    }
    for name, (value, remedy) in needed.items():
        if value is None:
            yield Problem(name, f"is not stated; {remedy} in capture.toml and import again")
    if not session.nominal.boards:
        yield Problem("boards", "there are none; state [[boards]] in capture.toml and import again")
