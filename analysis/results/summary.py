"""The figures of a result, as values and as the JSON that a result file keeps."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from instrument.files.json_text import parse_json
from instrument.files.validation import InvalidInputError, Problem

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class Quantiles:
    """Mean, median and 95th percentile of a map's finite values; NaN if there are none."""

    mean: float
    median: float
    p95: float


@dataclass(frozen=True, slots=True)
class DepthShape:
    """Least-squares terms of depth, z = z_0 + tilt_x x + tilt_y y + bowl (x^2 + y^2) / 2 from the map's centre.

    Attributes
    ----------
    tilt_x, tilt_y : float
        Of the plane fitted alone, mm / mm; positive where depth rises to the right, or upwards.
    bowl : float
        Curvature in 1 / mm of the fit of plane and bowl; positive where the middle lies deepest.
    sag : float
        Height of that bowl's border above its middle, mm: at the known pixel farthest from the centre.
    rms, rms_without_plane, rms_without_bowl : float
        Root mean square in mm of depth about its mean, about the plane, about plane and bowl.
    """

    tilt_x: float
    tilt_y: float
    bowl: float
    sag: float
    rms: float
    rms_without_plane: float
    rms_without_bowl: float


@dataclass(frozen=True, slots=True)
class HeldOutView:
    """How well one view was predicted from the others.

    Attributes
    ----------
    view : int
    n_pixels, n_glossy : int
    relative_rms, lambert_relative_rms : float
        sqrt(sum (predicted - measured)^2 / sum measured^2), with the dictionary and with a Lambertian fit.
    psnr_db, lambert_psnr_db : float
        Against the brightest unclipped measured value of the view.
    glossy_gain_db : float
        How far the dictionary's PSNR lies above the Lambertian one on glossy pixels; NaN if there are none.
    relative_rms_with_gain : float or None
        As `relative_rms`, after one free factor on the prediction: without what nobody can know of a view's exposure.
        None in files that were written before it was told.
    """

    view: int
    n_pixels: int
    n_glossy: int
    relative_rms: float
    lambert_relative_rms: float
    psnr_db: float
    lambert_psnr_db: float
    glossy_gain_db: float
    relative_rms_with_gain: float | None = None


@dataclass(frozen=True, slots=True)
class SourceFile:
    """The file that a result was made of: its name without folders, and its SHA-256."""

    file: str
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """Figures of a result; what does not apply is None and has no key in the file.

    Attributes
    ----------
    n_views, n_pixels, n_unsolved : int
    pixel_pitch_mm : float or None
    share_glossy : float or None
        Of the solved pixels.
    theta_h_range_deg : (float, float)
        Smallest and largest half angle that the typical pixel was seen at, degrees.
    theta_d_deg : (float, float), or None
        Half the angle between the directions to camera and light: of the typical view, and the largest.
    camera_moves : bool or None
        Whether the camera looks from several directions. None, as `theta_d_deg`, in files from before it was told.
    normal_sigma_deg : Quantiles
        Stated standard deviation of the normals per tangent axis, degrees.
    reduced_chi2 : Quantiles or None
    relative_error : float
        Noise of the model, relative to the radiance.
    depth_shape : DepthShape or None
        None without a depth.
    n_materials : int or None
        Of the palette, where there is one.
    light_offset_mm, light_offset_sigma_mm : tuple of 3 float, or None
        Camera frame, mm; where the highlights told it.
    error_budget_deg : dict of str to float, or None
        What each source adds to the normals, degrees per axis.
    normal_error_deg : Quantiles or None
        Against the truth, as all that follow to `coverage95`; None without a truth.
    depth_rmse_mm, depth_rmse_without_plane_mm : float or None
    coverage68, coverage95 : float or None
        Share of the true normals within their stated 68 % and 95 % intervals.
    left_out : tuple of HeldOutView
        Views held out of the fit in turn.
    options : dict or None
        `analysis.reconstruction.reconstruction.Options` of the run, as provenance.
    source : SourceFile or None
        None where the stack was not read from a file.
    calibration : dict or None
        Figures of the calibration, whatever made the stack.
    """

    n_views: int
    n_pixels: int
    n_unsolved: int
    pixel_pitch_mm: float | None = None
    share_glossy: float | None = None
    theta_h_range_deg: tuple[float, float]
    theta_d_deg: tuple[float, float] | None = None
    camera_moves: bool | None = None
    normal_sigma_deg: Quantiles
    reduced_chi2: Quantiles | None = None
    relative_error: float
    depth_shape: DepthShape | None = None
    n_materials: int | None = None
    light_offset_mm: tuple[float, float, float] | None = None
    light_offset_sigma_mm: tuple[float, float, float] | None = None
    error_budget_deg: dict[str, float] | None = None
    normal_error_deg: Quantiles | None = None
    depth_rmse_mm: float | None = None
    depth_rmse_without_plane_mm: float | None = None
    coverage68: float | None = None
    coverage95: float | None = None
    left_out: tuple[HeldOutView, ...] = ()
    options: dict[str, Any] | None = None
    source: SourceFile | None = None
    calibration: dict[str, Any] | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the figures for JSON, in the order of the attributes."""
        return {name: value for name, value in plain(self).items() if value is not None}


def plain(value: Any) -> Any:
    """Return values for JSON: dataclasses as dictionaries by field, tuples as lists."""
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return [plain(element) for element in value] if isinstance(value, list | tuple) else value


def value_from_json(kind: type[Value], text: str, where: str) -> Value:
    """Return what a text of a file says, as a value of `kind`; keys that it does not know are no matter.

    Parameters
    ----------
    kind : type
        A frozen dataclass, or a tuple of them.
    text : str
        From a file that anybody may have written.
    where : str
        Path of the text in its file, for messages.

    Raises
    ------
    InvalidInputError
        With everything that is missing or of another kind, by its path.
    """
    value = parse_json(text)
    try:
        # By way of JSON, since only there pydantic's strict mode takes a list for a tuple.
        return TypeAdapter(kind).validate_json(json.dumps(value), strict=True)
    except ValidationError as error:
        problems = [_problem(where, details) for details in error.errors(include_url=False)]
        raise InvalidInputError(f"{where} is not what a result says.", problems) from None


_MUST_BE = {
    "int": "a whole number",
    "float": "a number",
    "string": "a text",
    "dict": "values by name",
    "dataclass": "values by name",
    "tuple": "a list",
}


def _problem(where: str, details: ErrorDetails) -> Problem:
    path = where + "".join(_steps(details["loc"]))
    if details["type"] == "missing":
        return Problem(path, "is missing")
    must_be = _MUST_BE.get(details["type"].partition("_")[0])
    text = repr(details["input"])
    shown = text if len(text) <= 40 else f"{text[:37]}..."
    return Problem(path, f"is {shown}; " + (f"must be {must_be}" if must_be else details["msg"]))


def _steps(path: tuple[int | str, ...]) -> Iterator[str]:
    for step in path:
        yield f"[{step}]" if isinstance(step, int) else f".{step}"
