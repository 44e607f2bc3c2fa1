"""Samples of one pixel as values of the BRDF at their half angles, next to the fitted curve."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.problem import PixelProblem
from analysis.pixels.samples import OUTLIER
from analysis.reflectance.models import Cosines
from analysis.registration.stack import Stack
from analysis.registration.stack_file import is_stack, read_stack
from analysis.results.result import FLAG_NAMES, Result
from instrument.files.digests import file_digest
from instrument.files.probe import refuse_dangerous
from instrument.files.validation import InvalidInputError, Problem

Array = NDArray[np.float64]

USED, CLIPPED, WRONG, UNSEEN = range(4)

USES = ("used", "clipped (a lower bound)", "does not fit (weighed down)", "not seen")
"""What became of a sample, by the values of `PointSamples.use`."""

CURVE_DEG = np.linspace(0.0, 85.0, 171)
"""Half angles of a curve."""

TITLE = "The samples cannot be shown."


@dataclass(frozen=True, slots=True)
class PointCurve:
    """The fit of one pixel.

    Attributes
    ----------
    row, column : int
    theta_h : ndarray, shape (A,)
        Half angles, rad.
    f : ndarray, shape (A, C)
        BRDF on the slice theta_d = 0, 1/sr; NaN where the pixel is unsolved.
    seen : tuple of float
        Smallest and largest half angle that it was seen at, rad.
    normal_sigma : float
        Standard deviation of the normal per tangent axis, rad.
    flags : tuple of str
        What is to be said of the pixel.
    """

    row: int
    column: int
    theta_h: Array
    f: Array
    seen: tuple[float, float]
    normal_sigma: float
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PointSamples:
    """The samples of one pixel in N views.

    Attributes
    ----------
    theta_h : ndarray, shape (N,)
        Half angles to the fitted normal, rad; NaN where the pixel is unsolved.
    f : ndarray, shape (N, C)
        radiance d^2 / (P n.omega_i), 1/sr; NaN where it is not seen.
    sigma : ndarray, shape (N, C)
        One standard deviation of `f` as the fit took it.
    use : ndarray of uint8, shape (N, C)
        `USED`, `CLIPPED`, `WRONG` or `UNSEEN`.
    """

    theta_h: Array
    f: Array
    sigma: Array
    use: NDArray[np.uint8]


def point_curve(result: Result, row: int, column: int) -> PointCurve:
    """Return the fitted curve of a pixel.

    Raises
    ------
    IndexError
        If there is no such pixel.
    """
    fits = result.fits.select(np.array([_index(result, row, column)]))
    theta_h = np.deg2rad(CURVE_DEG)
    f = fits.brdf(Cosines.on_slice(theta_h[None]))[0]
    near, far = fits.theta_h_range[0].tolist()
    flags = tuple(text for bit, text in FLAG_NAMES.items() if fits.flags[0] & bit)
    if not np.isfinite(fits.normals[0, 0]):
        f, flags = np.full_like(f, np.nan), ("unsolved", *flags)
    return PointCurve(row, column, theta_h, f, (near, far), float(fits.normal_sigma[0]), flags)


def point_samples(result: Result, stack: Stack, row: int, column: int) -> PointSamples:
    """Take the samples of a pixel out of the stack that a result came from.

    Parameters
    ----------
    result : Result
        With `views`.
    stack : Stack
        As in its file; it is seen as it was fitted.
    row, column : int

    Raises
    ------
    IndexError
        If there is no such pixel.
    """
    views = result.views
    assert views is not None, "a stack is only found for a result that knows its views"
    pixel = np.array([_index(result, row, column)])
    fits = result.fits.select(pixel)
    problem = PixelProblem(views.applied_to(stack, result.depth), fits.dictionary, pixel, result.depth)
    omega_i, h = problem.directions()
    n_dot_l = np.sum(fits.normals * omega_i, axis=-1)
    # Beyond the horizon there is no irradiance to divide by.
    with np.errstate(divide="ignore", invalid="ignore"):
        to_brdf = np.where(n_dot_l > 0.0, problem.gain() / n_dot_l, np.nan)[:, 0, None]
    radiance, model = problem.samples.radiance[:, 0].astype(np.float64), problem.model(fits)[:, 0]
    sigma = np.sqrt(problem.samples.variance[:, 0] + views.noise.floor**2 + (views.noise.relative * model) ** 2)
    f, sigma_f = radiance * to_brdf, sigma * to_brdf
    use = _use(radiance - model, sigma, problem.samples.saturated[:, 0] > 0, np.isfinite(f))
    return PointSamples(_angle(fits.normals[0], h[:, 0]), f, sigma_f, use)


def counts_by_use(samples: PointSamples) -> tuple[int, ...]:
    """Return how many samples ended how, in the order of `USES`."""
    return tuple(np.bincount(samples.use.ravel(), minlength=len(USES)).tolist())


def _use(residual: Array, sigma: Array, clipped: NDArray[np.bool_], seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Tell what became of samples (N, C): a view fits or does not with all its channels, as in the fit."""
    kept = clipped & (residual < 0.0)
    chi2 = np.where(seen & ~kept & (sigma > 0.0), (residual / np.where(sigma > 0.0, sigma, 1.0)) ** 2, 0.0)
    wrong = np.sum(np.nan_to_num(chi2), axis=1) > OUTLIER * np.maximum(seen.sum(axis=1), 1)
    use = np.where(clipped, CLIPPED, np.where(wrong[:, None], WRONG, USED))
    return np.where(seen, use, UNSEEN).astype(np.uint8)


def _angle(normal: Array, h: Array) -> Array:
    return np.asarray(np.arccos(np.clip(h @ normal, -1.0, 1.0)))


def _index(result: Result, row: int, column: int) -> int:
    height, width = result.grid.height, result.grid.width
    if not (0 <= row < height and 0 <= column < width):
        allowed = f"rows are 0 to {height - 1}, columns 0 to {width - 1}"
        raise IndexError(f"there is no pixel in row {row}, column {column}; {allowed}")
    return row * width + column


def source_stack(path: Path, result: Result, stack: Path | None = None) -> Stack:
    """Read the stack that a result came from, having made sure of it.

    Parameters
    ----------
    path : Path
        Of the result; the stack is looked for beside it.
    result : Result
    stack : Path, optional
        Where the stack lies instead.

    Raises
    ------
    InvalidInputError
        If it is not there, is not the one, or cannot be read.
    """
    name, digest = _stated(path, result)
    place = stack or path.parent / name
    if not place.is_file():
        raise _refused(place, f"is not there; put {name}, which {path.name} came from, beside it")
    refuse_dangerous(place)
    if not is_stack(place):
        what = "is the session; its registered stack was not kept. Write one with `halfangle calibrate"
        raise _refused(place, f"{what} {name} -o area.stack.h5` and reconstruct that")
    if file_digest(place) != digest:
        raise _refused(place, f"is not the file that {path.name} came from, or has changed since; reconstruct it")
    return _checked(place, read_stack(place), result)


def _stated(path: Path, result: Result) -> tuple[str, str]:
    source = result.summary.source
    if result.views is None or source is None or not Path(source.file).name:
        what = "does not say which stack it came from and how it was fitted; reconstruct it with this version"
        raise _refused(path, what)
    # A result from elsewhere must not make us read files anywhere else.
    return Path(source.file).name, source.sha256


def _checked(place: Path, stack: Stack, result: Result) -> Stack:
    assert result.views is not None
    expected = (len(result.views.light_power), result.grid.height, result.grid.width, result.fits.atom.shape[1])
    if stack.radiance.shape != expected:
        raise _refused(place, f"has radiances of shape {stack.radiance.shape}; the result is of {expected}")
    return stack


def _refused(place: Path, what: str) -> InvalidInputError:
    return InvalidInputError(TITLE, [Problem(str(place), what)])


class PointSource:
    """The samples of points of one result, whose stack is found and made sure of at the first.

    Parameters
    ----------
    path : Path
        Of the result.
    result : Result

    Attributes
    ----------
    path : Path
    result : Result
    """

    def __init__(self, path: Path, result: Result) -> None:
        self.path, self.result = path, result
        self._stack: Stack | None = None

    def at(self, row: int, column: int) -> PointSamples:
        """Return the samples of a pixel.

        Raises
        ------
        InvalidInputError
            If the stack is not there, is not the one, or cannot be read.
        IndexError
            If there is no such pixel.
        """
        if self._stack is None:
            self._stack = source_stack(self.path, self.result)
        return point_samples(self.result, self._stack, row, column)
