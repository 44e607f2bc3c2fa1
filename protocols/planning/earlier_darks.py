"""Darks and flats of an earlier session, in place of taking them again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription
from instrument.config.protocol import DarksAndFlatsConfig
from instrument.files.validation import InvalidInputError, Problem
from instrument.session import layout
from instrument.session.layout import Field
from instrument.session.session import Session
from instrument.session_tools.verify import plan_problems

# Exposure times that differ by less are the same setting of a camera.
_SAME_TIME = 1e-3

WHERE = "darks_and_flats.session"


@dataclass(frozen=True, slots=True)
class KeptFrames:
    """What a session of darks and flats gives to another one.

    Attributes
    ----------
    path : Path
    digest : str
        Of that session, for provenance.
    serial_number : str
        Of its camera.
    frame_shape : tuple of int
        Height and width.
    conversion_gain : float
        Electrons per count, which tells the gain that they were taken at.
    rig_text : str
        Its rig file, to the letter.
    age_hours : float
        Since its darks were taken.
    exposure_times : tuple of float
        Of its darks, seconds.
    values : mapping of Field to array
        Its darks and flats; those of the darks with one element per exposure time.
    """

    path: Path
    digest: str
    serial_number: str
    frame_shape: tuple[int, ...]
    conversion_gain: float
    rig_text: str
    age_hours: float
    exposure_times: tuple[float, ...]
    values: Mapping[Field, NDArray[Any]]

    @classmethod
    def read(cls, path: Path) -> KeptFrames:
        """Read a session of darks and flats.

        Raises
        ------
        InvalidInputError
            If it is no usable session, or holds no darks.
        """
        with Session(path) as session:
            problems = list(plan_problems(session))
            if session.dark is None:
                problems.append(Problem(str(path), "holds no darks; capture it with bracket.darks of 2 or more"))
            if problems:
                raise InvalidInputError(f"{path} cannot give darks and flats", problems)
            return cls(
                path=path,
                digest=session.digest(),
                serial_number=session.camera.serial_number,
                frame_shape=session.camera.frame_shape,
                conversion_gain=session.camera.conversion_gain,
                rig_text=session.rig_text,
                age_hours=_age_hours(session),
                exposure_times=tuple(session.exposure_times.tolist()),
                values=_values(session),
            )

    def problems(
        self, config: DarksAndFlatsConfig, camera: CameraDescription, times: tuple[float, ...]
    ) -> Iterator[Problem]:
        """Yield why they cannot be used with a camera at some exposure times (seconds)."""
        if self.serial_number != camera.serial_number:
            yield Problem(WHERE, f"{self.path} is of camera {self.serial_number!r}, this is {camera.serial_number!r}")
        if self.frame_shape != (camera.height, camera.width):
            yield Problem(WHERE, f"{self.path} has frames of {self.frame_shape}, this camera's are of another size")
        if not np.isclose(self.conversion_gain, camera.conversion_gain, rtol=0.01, equal_nan=True):
            gains = f"{self.conversion_gain:g} and now {camera.conversion_gain:g} electrons per count"
            yield Problem(WHERE, f"{self.path} was taken at another gain: {gains}")
        if self.age_hours > config.largest_age_h:
            yield Problem(
                WHERE,
                f"the darks of {self.path} are {self.age_hours:.1f} h old; allowed is {config.largest_age_h:g} h. "
                "Take new ones, or raise darks_and_flats.largest_age_h",
            )
        for time in times:
            if self._index(time) is None:
                has = ", ".join(f"{t:g}" for t in self.exposure_times)
                yield Problem(WHERE, f"{self.path} has no dark of {time:g} s; it has {has} s")

    @property
    def temperature(self) -> float:
        """Of the sensor at the darks, degrees Celsius; NaN where it is not known."""
        known = self.values.get(layout.DARK_TEMPERATURE)
        return np.nan if known is None else float(known.mean())

    def darkness(self, times: tuple[float, ...]) -> tuple[float, ...]:
        """Return the mean counts of the darks of exposure times `times` (seconds), all known."""
        return tuple(float(frame.mean()) for frame in self.for_times(times)[layout.DARK])

    def for_times(self, times: tuple[float, ...]) -> dict[Field, NDArray[Any]]:
        """Return the fields of a session that begins now with exposure times `times` (seconds), all known."""
        of_dark = {layout.DARK, layout.DARK_VARIANCE, layout.DARK_TIMESTAMP, layout.DARK_TEMPERATURE}
        index = [i for time in times if (i := self._index(time)) is not None]
        chosen = {field: value[index] if field in of_dark else value for field, value in self.values.items()}
        # Times count from the begin of a session: what was taken before it has a negative one.
        chosen[layout.DARK_TIMESTAMP] = np.full(len(index), -3600.0 * self.age_hours)
        return chosen

    def _index(self, time: float) -> int | None:
        near = [i for i, t in enumerate(self.exposure_times) if abs(t - time) <= _SAME_TIME * time]
        return near[0] if near else None


def _age_hours(session: Session) -> float:
    started = datetime.fromisoformat(session.start_time)
    taken = float(np.min(session.dark_timestamps))
    return (datetime.now(UTC) - started).total_seconds() / 3600.0 - taken / 3600.0


def _values(session: Session) -> dict[Field, NDArray[Any]]:
    dark, variance = session.dark, session.dark_variance
    if dark is None or variance is None:
        return {}
    values: dict[Field, NDArray[Any]] = {layout.DARK: dark, layout.DARK_VARIANCE: variance}
    if session.dark_temperatures is not None:
        values[layout.DARK_TEMPERATURE] = session.dark_temperatures
    times = session.extra.flat_times
    if times.size and np.isfinite(times).all():
        values[layout.FLAT_IMAGES] = np.stack([session.extra.flat_images(i) for i in range(times.size)])
        values[layout.FLAT_TIME] = times
        values[layout.FLAT_DISTANCE] = session.extra.flat_distances_mm
    return values
