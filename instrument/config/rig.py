"""The values of `rig.toml`: which devices, how they stand, what they may do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, ValidationError, create_model, model_validator

from drivers.driver import Kind
from drivers.errors import DeviceError, DriverNotFoundError
from drivers.registry import KINDS, SIMULATED, check_one_world, settings_of
from instrument.config.boards import BoardConfig, Rectangle, board_misfits
from instrument.config.messages import complaints, validate
from instrument.config.tables import NonNegative, Positive, Settings, SettingsFile, Vector
from instrument.config.toml_lines import KeyPath

Driver = Annotated[str, Field(min_length=1, description="which driver talks to it")]

DeviceTable = Annotated[dict[str, Any], Field(default_factory=dict, description="the driver's own settings")]

Share = Annotated[float, Field(ge=0, lt=1)]


class CameraConfig(Settings):
    """`[camera]`: the driver and the lens."""

    driver: Driver
    device: DeviceTable
    serial_number: str | None = Field(default=None, description="the one device allowed; any if not given")
    width: int = Field(ge=16, le=16384, multiple_of=2, description="pixels across a raw frame")
    height: int = Field(ge=16, le=16384, multiple_of=2, description="pixels down a raw frame")
    focal_length_px: Positive = Field(description="nominal focal length in pixels")


class LightConfig(Settings):
    """`[light]`: the driver, where the light stands, how bright it shines."""

    driver: Driver
    device: DeviceTable
    serial_number: str | None = Field(default=None, description="the one device allowed; any if not given")
    offset_mm: Vector = Field(description="from the lens, in the camera frame (x right, y down, z forward), mm")
    offset_sigma_mm: Positive = Field(description="standard deviation of each part of offset_mm, mm")
    level: float = Field(default=1.0, gt=0, le=1, description="relative brightness")
    warm_up_s: NonNegative = Field(
        default=0.0, description="time that it takes to warm up, as rated, lit, seconds; 0 = none"
    )
    steady_per_minute: Positive = Field(default=1e-3, description="relative drift per minute of a warm light")
    drift_band: Positive = Field(default=0.05, description="relative change since it was warm that is flagged")


class StageConfig(Settings):
    """`[stage]`: the driver."""

    driver: Driver
    device: DeviceTable
    serial_number: str | None = Field(default=None, description="the one device allowed; any if not given")


class GeometryConfig(Settings):
    """`[geometry]`: the sample before the lens."""

    working_distance_mm: Positive = Field(description="lens to sample, nominal, mm")
    area_mm: tuple[Positive, Positive] = Field(description="width and height to reconstruct, mm")

    @property
    def rectangle(self) -> Rectangle:
        """Left, bottom, right and top edge in mm: the area is centred on the origin."""
        width, height = self.area_mm
        return (-width / 2, -height / 2, width / 2, height / 2)


class SimulationConfig(Settings):
    """`[simulation]`: what the simulated devices share; the truth that the analysis must find out."""

    seed: int = Field(default=0, ge=0, description="of every random number of the simulated rig")
    scene: Literal["relief", "plane", "sphere_cap"] = Field(default="relief", description="the sample")
    light_offset_mm: Vector | None = Field(
        default=None, description="true light position in the camera frame, mm; light.offset_mm if not given"
    )
    power_jitter: Share = Field(default=0.01, description="standard deviation of power from pose to pose")
    warm_up_drift: Share = Field(default=0.02, description="share of power lost while warming up")
    warm_up_s: Positive = Field(default=120.0, description="lit seconds that the warm-up takes")
    distortion: tuple[float, float] = Field(default=(0.0, 0.0), description="k1, k2 of Brown-Conrady")
    vignetting: Share = Field(default=0.1, description="share of light lost in the picture's corners")
    lobe_exponent: NonNegative = Field(default=2.0, description="m, where the light shines as cos^m")
    mount_rotation_deg: NonNegative = Field(default=0.5, description="standard deviation of the stage's tilt")
    mount_translation_mm: NonNegative = Field(default=0.5, description="and of its place, per axis")
    axis_error_deg: NonNegative = Field(default=0.02, description="standard deviation from the read-back")
    focal_length_error: Share = Field(default=0.003, description="relative standard deviation")
    principal_point_px: NonNegative = Field(default=2.0, description="standard deviation in pixels")
    real_time: bool = Field(default=False, description="motions and exposures take their time; else none of yours")


class RigConfig(SettingsFile):
    """A rig; `model_dump()` of it is what the drivers receive."""

    name: Annotated[str, Field(min_length=1)] = Field(description="what the rig is called")
    camera: CameraConfig
    light: LightConfig
    stage: StageConfig
    geometry: GeometryConfig
    boards: tuple[BoardConfig, ...] = ()
    simulation: SimulationConfig = SimulationConfig()

    @property
    def serial_numbers(self) -> dict[str, str]:
        """Serial number of each device that is named by one."""
        stated = {kind: getattr(self, kind).serial_number for kind in ("camera", "light", "stage")}
        return {kind: serial for kind, serial in stated.items() if serial is not None}

    @model_validator(mode="after")
    def _parts_fit(self) -> RigConfig:
        tables = self.model_dump(exclude_unset=True)
        misfits = [text for _, text in rig_misfits(tables, dict(enumerate(self.boards)), self.geometry)]
        if misfits:
            raise ValueError("; ".join(misfits))
        return self


def rig_misfits(
    tables: Mapping[str, Any], boards: Mapping[int, BoardConfig], geometry: GeometryConfig | None
) -> Iterator[tuple[KeyPath, str]]:
    """Yield where and why tables that are well formed by themselves do not fit each other, or their drivers.

    Parameters
    ----------
    tables : mapping
        The file as it was parsed.
    boards : mapping
        Those of its boards that are well formed, by their place in the file.
    geometry : GeometryConfig or None
        If that is well formed.
    """
    yield from driver_misfits(tables)
    yield from board_misfits(boards, None if geometry is None else geometry.rectangle, "geometry.area_mm")
    if SIMULATED in drivers_named(tables).values():
        yield from _not_drawn(boards)


def _not_drawn(boards: Mapping[int, BoardConfig]) -> Iterator[tuple[KeyPath, str]]:
    """Yield what the simulated devices, which draw the boards themselves, cannot draw."""
    for i, board in boards.items():
        if board.kind != "charuco":
            yield ("boards", i, "kind"), f"boards[{i}].kind is {board.kind!r}; the simulated rig shows 'charuco' only"
        if board.corner_mm is None:
            yield ("boards", i, "corner_mm"), f"boards[{i}].corner_mm: the simulated rig needs the place in numbers"


def driver_misfits(tables: Mapping[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield what is wrong with the drivers of a parsed rig file and with their own tables.

    Parameters
    ----------
    tables : mapping
        The file; what is not well formed in it is left to others.
    """
    devices: dict[Kind, type[BaseModel]] = {}
    named = drivers_named(tables)
    for kind, name in named.items():
        try:
            devices[kind] = settings_of(kind, name)
        except DriverNotFoundError as error:
            yield (kind, "driver"), str(error)
    yield from _of_devices(devices, tables)
    try:
        check_one_world(named)
    except DeviceError as error:
        yield ("camera", "driver"), str(error)


def drivers_named(tables: Mapping[str, Any]) -> dict[Kind, str]:
    """Return the name of the driver by kind, where the parsed file gives one."""
    return {kind: name for kind in KINDS if isinstance(name := _table(tables, kind).get("driver"), str)}


def _of_devices(devices: Mapping[Kind, type[BaseModel]], tables: Mapping[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Validate the tables as one model, so that each problem has its path in the file."""
    parts: dict[str, Any] = {kind: create_model(kind, device=(model, ...)) for kind, model in devices.items()}
    rig = create_model("Rig", **parts)
    try:
        validate(rig, {kind: {"device": _table(tables, kind).get("device", {})} for kind in devices})
    except ValidationError as error:
        yield from complaints(rig, error)


def _table(tables: Mapping[str, Any], kind: str) -> Mapping[str, Any]:
    table = tables.get(kind)
    return table if isinstance(table, dict) else {}
