"""Warns when the light, the temperature of the sensor or clipping differ from the start of a capture."""

from __future__ import annotations

import math
from collections.abc import Callable

from instrument.rig.rig import Rig
from instrument.session.audit import AuditLog
from instrument.session.records import PoseRecord
from protocols.acquisition.frame_checks import CLIPPED_SHARE, clipped_shares
from protocols.capture.errors import PausedError


class PoseWatch:
    """Warns of poses that are not like the first one, or that lost something.

    Parameters
    ----------
    rig : Rig
    audit : AuditLog
        Takes a note of each warning.
    dark_temperature : float
        Of the sensor at the darks, degrees Celsius; NaN where not known.
    temperature_band : float
        How far the sensor may be from it at the first pose, degrees.
    pauses_when_clipped : bool
        Whether a pose that clips in its shortest exposure pauses the capture.
    warn : callable
        Tells a warning to the operator.
    """

    def __init__(
        self,
        rig: Rig,
        audit: AuditLog,
        dark_temperature: float,
        temperature_band: float,
        *,
        pauses_when_clipped: bool,
        warn: Callable[[str], None],
    ) -> None:
        self._rig, self._audit, self._warn = rig, audit, warn
        self._dark_temperature, self._temperature_band = dark_temperature, temperature_band
        self._pauses_when_clipped = pauses_when_clipped
        self._first_monitor = math.nan
        self._is_first = True

    def look(self, i_pose: int, record: PoseRecord) -> None:
        """Look at a pose that was taken.

        Raises
        ------
        PausedError
            If it clips, and the protocol says to pause there.
        """
        self._look_at_light(i_pose, record)
        if self._is_first:
            self._look_at_sensor(record)
            self._is_first = False
        self._look_for_clipping(i_pose, record)

    def _look_at_light(self, i_pose: int, record: PoseRecord) -> None:
        monitor = float(record.monitor.mean())
        if math.isnan(self._first_monitor):
            self._first_monitor = monitor
        change = monitor / self._first_monitor - 1.0 if self._first_monitor else math.nan
        if abs(change) > self._rig.config.light.drift_band:
            self._audit.note("drift", pose=i_pose, monitor=monitor, change=change)
            self._warn(f"the light's monitor changed by {change:+.1%} since the first pose (pose {i_pose})")

    def _look_at_sensor(self, record: PoseRecord) -> None:
        warmer = float(record.sensor_temperature.mean()) - self._dark_temperature
        if abs(warmer) > self._temperature_band:
            self._audit.note("temperature", warmer=warmer)
            self._warn(
                f"the sensor is {abs(warmer):.1f} degrees {'warmer' if warmer > 0 else 'colder'} than at the darks "
                f"(allowed {self._temperature_band:g}). Take new darks"
            )

    def _look_for_clipping(self, i_pose: int, record: PoseRecord) -> None:
        share = float(clipped_shares(record.counts[:1], self._rig.camera.describe())[0])
        if share <= CLIPPED_SHARE:
            return
        what = f"pose {i_pose}: {share:.1%} of the shortest exposure clips"
        self._audit.note("clipped", pose=i_pose, share=share)
        self._warn(f"{what}. Add a shorter exposure, or lower light.level")
        if self._pauses_when_clipped:
            raise PausedError(f"{what}, and the protocol says to pause there")
