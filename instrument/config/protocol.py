"""The values of `protocol.toml`: what to capture."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from instrument.config.tables import NonNegative, Positive, Settings, SettingsFile


class AutoConfig(Settings):
    """`[bracket.auto]`: what the bracket must reach; scout frames before the plan find the fewest exposures."""

    noise: float = Field(default=0.02, gt=0, lt=1, description="largest relative noise of the merged radiance")
    darkest_percent: float = Field(default=1.0, ge=0, lt=50, description="share of pixels that may be noisier, percent")
    shortest_s: Positive = Field(default=1e-4, description="shortest exposure time to choose, seconds")
    longest_s: Positive = Field(default=1.0, description="longest exposure time to choose, seconds")
    most_exposures: int = Field(default=8, ge=1, le=32, description="how many exposures are allowed")

    @model_validator(mode="after")
    def _in_order(self) -> AutoConfig:
        if self.longest_s < self.shortest_s:
            raise ValueError(f"longest_s ({self.longest_s:g}) is less than shortest_s ({self.shortest_s:g})")
        return self


class BracketConfig(Settings):
    """`[bracket]`: the exposures at each pose."""

    exposure_times_s: tuple[Positive, ...] | None = Field(
        default=None, min_length=1, max_length=32, description="one frame each, in seconds, ascending"
    )
    auto: AutoConfig | None = Field(default=None, description="a table that stands in place of exposure_times_s")
    darks: int = Field(default=4, ge=0, le=1000, description="dark frames per exposure time; not 1")
    when_clipped: Literal["flag", "pause", "shorter"] = Field(
        default="flag", description="what to do at a pose whose shortest exposure clips"
    )

    @model_validator(mode="after")
    def _one_way(self) -> BracketConfig:
        if (self.exposure_times_s is None) == (self.auto is None):
            raise ValueError("state either exposure_times_s or a table [bracket.auto]")
        return self

    @field_validator("exposure_times_s")
    @classmethod
    def _ascending(cls, times: tuple[float, ...] | None) -> tuple[float, ...] | None:
        for i, (earlier, later) in enumerate(pairwise(times or ())):
            if later <= earlier:
                how = "repeats" if later == earlier else "is shorter than"
                raise ValueError(
                    f"times must ascend and be unique, but element {i + 1} ({later:g} s) {how} "
                    f"element {i} ({earlier:g} s)"
                )
        return times

    @field_validator("darks")
    @classmethod
    def _darks_with_variance(cls, darks: int) -> int:
        if darks == 1:
            raise ValueError("use 0, or 2 and more: one dark frame has no variance")
        return darks


class RingConfig(Settings):
    """One of `[[rings]]`: `count` poses at one tilt, evenly round the turntable."""

    tilt_deg: float = Field(ge=-180, le=180, description="position of axis 'tilt', degrees")
    count: int = Field(ge=1, le=10000, description="how many poses")
    start_deg: float = Field(default=0.0, ge=-360, le=360, description="'turn' of the first pose, degrees")


class PoseConfig(Settings):
    """One of `[[poses]]`: a position for every axis by name."""

    axes: dict[str, float] = Field(min_length=1, description="position of each axis, in deg or mm as the stage has it")


class FlatsConfig(Settings):
    """`[flats]`: frames of an even plane at the first pose, before all others."""

    exposure_time_s: Positive = Field(description="of each frame, seconds; it must not clip")
    count: int = Field(ge=1, le=1000, description="how many frames")


class DarksAndFlatsConfig(Settings):
    """`[darks_and_flats]`: take them from an earlier session in place of taking them again."""

    session: Annotated[str, Field(min_length=1)] = Field(description="its file, from the folder of the protocol")
    largest_age_h: Positive = Field(default=24.0, description="older ones are refused, hours")
    largest_temperature_difference: Positive = Field(
        default=5.0, description="of the sensor, from then to now, degrees Celsius; beyond it a warning is noted"
    )


class WatchConfig(Settings):
    """`[watch]`: go through all poses again and again, to see what drifts."""

    repeats: int = Field(ge=1, le=100_000, description="how many times")
    interval_s: NonNegative = Field(default=0.0, description="from the begin of one pose to that of the next, seconds")


class ProtocolConfig(SettingsFile):
    """A protocol: brackets over rings, single poses and chosen ones; rings first, in the order of the file."""

    name: Annotated[str, Field(min_length=1)] = Field(description="what the protocol is called")
    sample: str = Field(default="", description="what lies on the stage")
    bracket: BracketConfig
    rings: tuple[RingConfig, ...] = ()
    poses: tuple[PoseConfig, ...] = ()
    chosen: ChosenConfig | None = None
    flats: FlatsConfig | None = None
    darks_and_flats: DarksAndFlatsConfig | None = None
    watch: WatchConfig | None = None

    @model_validator(mode="after")
    def _some_poses(self) -> ProtocolConfig:
        if not self.rings and not self.poses and not self.chosen:
            raise ValueError("there is nothing to capture: add a [[rings]], a [[poses]] or a [chosen] table")
        return self

    @model_validator(mode="after")
    def _same_axes(self) -> ProtocolConfig:
        names = [{"tilt", "turn"}] * bool(self.rings) + [set(pose.axes) for pose in self.poses]
        for i, other in enumerate(names[1:], start=len(self.poses) - len(names) + 1):
            if other != names[0]:
                raise ValueError(
                    f"poses[{i}].axes names {sorted(other)}; every pose must place the same axes, here "
                    f"{sorted(names[0])}"
                )
        return self


class ChosenConfig(Settings):
    """`[chosen]`: so many poses, chosen for the rig and a rough idea of the material.

    The material needs to be right within a factor of two only; the defaults are a satin surface. Matte is about
    ``roughness = 0.8``, glossy ``roughness = 0.35``.
    """

    count: int = Field(ge=1, le=200, description="how many poses to choose")
    largest_tilt_deg: float = Field(
        default=60.0,
        gt=0,
        le=75,
        description="largest angle between the plate's normal and the line to the lens, degrees",
    )
    albedo: float = Field(default=0.4, gt=0, le=1, description="share of the light that the base gives back, 0 to 1")
    f0: float = Field(default=0.05, gt=0, le=1, description="reflectance of the surface straight on, 0 to 1")
    roughness: float = Field(default=0.55, ge=0.2, le=1, description="0.2 = glossy, 1 = matte; its square is GGX alpha")
