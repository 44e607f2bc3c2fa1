"""The values of `capture.toml`: what the files of pictures from elsewhere do not say themselves."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from instrument.config.boards import BoardConfig, Rectangle, board_misfits
from instrument.config.loading import load_settings
from instrument.config.messages import valid_or_none
from instrument.config.tables import NonNegative, Positive, Settings, SettingsFile, Vector
from instrument.config.toml_lines import KeyPath

Files = Annotated[tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1)]

Times = Annotated[tuple[Positive, ...], Field(min_length=1)]

FILES = "pictures within the folder; * and ? stand for any letters"

TIMES = "exposure time of each picture in seconds, one for all if alike; the files' own if not given"


class CameraTable(Settings):
    """`[camera]`: what replaces or completes what the files say of the camera."""

    make: str | None = Field(default=None, description="who made it")
    model: str | None = Field(default=None, description="which it is")
    serial_number: str | None = Field(default=None, description="its serial number")
    bayer_pattern: Literal["RGGB", "BGGR", "GRBG", "GBRG", ""] | None = Field(
        default=None, description='colours of the 2 x 2 cell in reading order, "" for none'
    )
    bit_depth: int | None = Field(default=None, ge=8, le=16, description="bits of a count as the sensor reads it out")
    black_level: tuple[NonNegative, ...] | None = Field(
        default=None, description="counts of darkness: one number, or one for each place of the 2 x 2 cell"
    )
    saturation_level: Positive | None = Field(default=None, description="counts at which the sensor clips")
    conversion_gain: Positive | None = Field(default=None, description="electrons per count")
    read_noise: NonNegative | None = Field(default=None, description="standard deviation of the read-out in electrons")

    @field_validator("black_level", mode="before")
    @classmethod
    def _one_or_four(cls, level: object) -> object:
        return _as_tuple(level)

    @field_validator("black_level")
    @classmethod
    def _of_a_cell(cls, level: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if level is not None and len(level) not in (1, 4):
            raise ValueError("it must be one number, or a list of four in reading order")
        return level


class IntrinsicsTable(Settings):
    """`[intrinsics]`: the lens, known from elsewhere; pixels, integers are the centres of pixels."""

    fx: Positive = Field(description="focal length across in pixels")
    fy: Positive = Field(description="focal length down in pixels")
    cx: float = Field(description="principal point, pixels from the left")
    cy: float = Field(description="principal point, pixels from the top")
    distortion: tuple[float, ...] = Field(
        default=(), max_length=5, description="k1, k2, p1, p2, k3 of Brown-Conrady, those left out are 0"
    )


class LightTable(Settings):
    """`[light]`: where the light stands."""

    offset_mm: Vector = Field(description="from the lens, in the camera frame (x right, y down, z forward), mm")
    offset_sigma_mm: Positive = Field(description="standard deviation of each part of offset_mm, mm")


class AreaTable(Settings):
    """`[area]`: what to reconstruct; centred on the origin of the sample frame."""

    width_mm: Positive = Field(description="width in mm")
    height_mm: Positive = Field(description="height in mm")
    pitch_mm: Positive | None = Field(default=None, description="size of a pixel of the maps in mm")

    @property
    def rectangle(self) -> Rectangle:
        """Left, bottom, right and top edge in mm."""
        return (-self.width_mm / 2, -self.height_mm / 2, self.width_mm / 2, self.height_mm / 2)


class PoseTable(Settings):
    """One of `[[poses]]`: the bracket of one pose."""

    files: Files = Field(description=FILES)
    exposure_times_s: Times | None = Field(default=None, description=TIMES)
    ambient: tuple[str, ...] = Field(default=(), max_length=1, description="the pose without the light, one picture")


class GroupingTable(Settings):
    """`[grouping]`: how the pictures of a folder fall into poses, in the order of their names."""

    glob: str = Field(default="*", min_length=1, description="which pictures; * and ? stand for any letters")
    by: Literal["exposure"] | None = Field(
        default=None, description="a new pose begins where an exposure time comes again"
    )
    frames_per_pose: int | None = Field(default=None, ge=1, le=256, description="pictures of each pose")
    exposure_times_s: Times | None = Field(
        default=None, description="exposure time of each picture of a pose in seconds; the files' own if not given"
    )

    @model_validator(mode="after")
    def _one_way(self) -> GroupingTable:
        if self.by is not None and self.frames_per_pose is not None:
            raise ValueError('by = "exposure" and frames_per_pose exclude each other; keep one')
        if self.by is not None and self.exposure_times_s is not None:
            raise ValueError('by = "exposure" needs the times of the files; leave exposure_times_s out')
        n_times, n_frames = len(self.exposure_times_s or ()), self.frames_per_pose or 1
        if n_times not in (0, n_frames):
            raise ValueError(f"exposure_times_s has {n_times} elements; a pose has {n_frames} pictures")
        return self


class BesideTable(Settings):
    """`[darks]`: pictures beside those of the poses."""

    files: Files = Field(description=FILES)
    exposure_times_s: Times | None = Field(default=None, description=TIMES)


class AmbientTable(BesideTable):
    """`[ambient]`: one picture without the light, for all poses."""

    files: Annotated[Files, Field(max_length=1)] = Field(description="one picture within the folder")


class FlatsTable(BesideTable):
    """`[flats]`: an even plane, lit like the sample."""

    distance_mm: tuple[Positive, ...] | None = Field(
        default=None, description="lens to plane in mm: one number, or one for each picture"
    )

    @field_validator("distance_mm", mode="before")
    @classmethod
    def _one_or_each(cls, distance: object) -> object:
        return _as_tuple(distance)


class CaptureConfig(SettingsFile):
    """A `capture.toml`."""

    name: Annotated[str, Field(min_length=1)] = Field(description="what the capture is called")
    sample: str = Field(default="", description="what was captured")
    linear: bool | None = Field(default=None, description="whether counts are proportional to light")
    working_distance_mm: Positive | None = Field(default=None, description="lens to sample, nominal, mm")
    focal_length_px: Positive | None = Field(default=None, description="nominal focal length in pixels")
    camera: CameraTable = CameraTable()
    response: ResponseConfig | None = None
    intrinsics: IntrinsicsTable | None = None
    light: LightTable | None = None
    area: AreaTable | None = None
    boards: tuple[BoardConfig, ...] = ()
    poses: tuple[PoseTable, ...] = ()
    grouping: GroupingTable | None = None
    darks: BesideTable | None = None
    flats: FlatsTable | None = None
    ambient: AmbientTable | None = None


def load_capture(path: Path) -> CaptureConfig:
    """Read a `capture.toml`.

    Raises
    ------
    InvalidInputError
        With every problem found, each at ``file:line``.
    """
    return load_settings(CaptureConfig, path, capture_misfits)


def capture_misfits(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield where and why tables of a `capture.toml` do not fit each other, whatever else is wrong with them."""
    yield from capture_board_misfits(data)
    if "poses" in data and "grouping" in data:
        yield ("grouping",), "[[poses]] and [grouping] exclude each other; keep one of them"
    if "intrinsics" in data and "focal_length_px" in data:
        yield ("focal_length_px",), "[intrinsics] state the focal length already; leave focal_length_px out"
    yield from _linearity_misfits(data)


def capture_board_misfits(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield where and why boards do not fit each other or the area."""
    tables = data.get("boards")
    boards = [valid_or_none(BoardConfig, table) for table in tables] if isinstance(tables, list) else []
    area = valid_or_none(AreaTable, data.get("area"))
    well_formed = {i: board for i, board in enumerate(boards) if board is not None}
    yield from board_misfits(well_formed, None if area is None else area.rectangle, "the [area]")


def _linearity_misfits(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    if data.get("linear") is False and "response" not in data:
        yield ("linear",), f"the pictures are not linear; {RESPONSE_REMEDY}"
    if data.get("linear") is True and "response" in data:
        yield (
            ("response",),
            "linear is true, so there is nothing to undo; leave [response] out or set linear = false",
        )


RESPONSE_REMEDY = (
    'add [response] with gamma = 2.2 or "srgb" for the curve they were made with, with curve = "file.csv" for a known '
    "one, or with bracket = { files = [...] }: a still scene at several exposure times, to estimate it from"
)


def _as_tuple(value: object) -> object:
    """Return a number as a tuple of one; after a validator of ours pydantic takes no list for a tuple either."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (value,)
    return tuple(value) if isinstance(value, list) else value


class BracketTable(Settings):
    """`bracket`: a still scene at several exposure times."""

    files: tuple[str, ...] = Field(
        min_length=1, description="pictures within the folder; * and ? stand for any letters"
    )
    times_s: Annotated[tuple[Positive, ...], Field(min_length=2)] | None = Field(
        default=None, description="exposure time of each in seconds; the files' own if not given"
    )


class ResponseConfig(Settings):
    """One of three ways to tell the curve."""

    gamma: float | str | None = Field(default=None, description="counts are light to the power 1 / gamma")
    curve: str | None = Field(default=None, description="CSV of count and linear value, or of count, red, green, blue")
    bracket: BracketTable | None = Field(default=None, description="a still scene, to estimate the curve from later")

    @field_validator("gamma", mode="before")
    @classmethod
    def _known_gamma(cls, gamma: object) -> object:
        if isinstance(gamma, int | float) and not isinstance(gamma, bool) and 0.2 <= gamma <= 5.0:
            return gamma
        if gamma == "srgb":
            return gamma
        raise ValueError('allowed: a number from 0.2 to 5, or "srgb"')

    @model_validator(mode="after")
    def _exactly_one(self) -> ResponseConfig:
        given = [key for key in ("gamma", "curve", "bracket") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"give exactly one of gamma, curve and bracket; here are {', '.join(given) or 'none'}")
        return self
