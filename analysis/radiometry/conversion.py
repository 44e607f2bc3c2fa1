"""How counts become radiance, with what was found on the way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.exposure_ratios import ExposureRatios
from analysis.radiometry.hdr import Counts, Sensor
from analysis.radiometry.response import Response
from analysis.radiometry.response_fit import PicturePrediction
from analysis.radiometry.saturation import Saturation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RadiometryFindings:
    """Figures for a report.

    Attributes
    ----------
    black_nominal, black_used : ndarray, shape (2, 2) of a mosaic or (3,) of channels
        Counts of darkness of each place of the cell, as stated and as subtracted (the darks' median).
    black_dark : ndarray or None
        Median of the darks; None if there are none.
    saturation : Saturation or None
        None where there is no pile-up to look for: linear floating-point pictures, and counts that are not linear.
    ratios : ExposureRatios
        From short to long; empty with one exposure.
    share_all_clipped : float
        Of pixels clipped even in the shortest exposure.
    n_nan, n_sampled : int
        Values that are no numbers, among those looked at.
    noise_estimated : bool
        Whether gain and read noise are from the pictures, or assumed, since nobody stated them.
    response : Response or None
        What makes counts linear; None if they are.
    response_slope : float
        Slope of log linear exposure over log time in the bracket of the response; NaN without one.
    response_predictions : tuple of PicturePrediction
        Each picture of that bracket from the others.
    """

    black_nominal: Array
    black_used: Array
    black_dark: Array | None
    saturation: Saturation | None
    ratios: ExposureRatios
    share_all_clipped: float
    n_nan: int
    n_sampled: int
    noise_estimated: bool
    response: Response | None
    response_slope: float
    response_predictions: tuple[PicturePrediction, ...]


@dataclass(frozen=True, slots=True)
class Radiometry:
    """How counts become radiance.

    Attributes
    ----------
    sensor : Sensor
        Of linear counts.
    black : ndarray
        Darks, shape of a bracket; or the black level of each place of the cell.
    response : Response or None
        What makes counts linear; None if they are.
    time_factors : ndarray, shape (n_exposures,)
        What to multiply the reported exposure times by; 1 where a response curve stands between counts and light,
        whose errors would pass for errors of the times.
    findings : RadiometryFindings
    """

    sensor: Sensor
    black: NDArray[Any]
    response: Response | None
    time_factors: Array
    findings: RadiometryFindings

    def linear(self, frames: NDArray[Any]) -> Counts:
        """Return frames as linear counts."""
        return linear_counts(frames, self.response)

    def dark_of(self, keep: NDArray[np.bool_]) -> NDArray[Any]:
        """Return the black of some of the exposures."""
        return self.black[keep] if self.black.ndim > 2 else self.black


def linear_counts(frames: NDArray[Any], response: Response | None) -> Counts:
    """Return frames as linear counts; with a response, what is clipped in one channel is clipped in all.

    The camera mixed the channels after the sensor had clipped, so that one that clips takes the others with it.
    """
    if response is None:
        return frames
    linear = response.linearise(frames)
    linear[(frames > response.highest).any(axis=-1)] = np.float32(response.curve.max())
    return linear
