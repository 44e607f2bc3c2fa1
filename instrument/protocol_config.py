"""The values of `protocol.toml`: what to capture."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from instrument.chosen_config import ChosenConfig
from instrument.settings import Positive, Settings, SettingsFile


class BracketConfig(Settings):
    """`[bracket]`: the exposures at each pose."""

    exposure_times_s: tuple[Positive, ...] = Field(
        min_length=1, max_length=32, description="one frame each, in seconds, ascending"
    )
    darks: int = Field(default=4, ge=0, le=1000, description="dark frames per exposure time; not 1")

    @field_validator("exposure_times_s")
    @classmethod
    def _ascending(cls, times: tuple[float, ...]) -> tuple[float, ...]:
        for i, (earlier, later) in enumerate(pairwise(times)):
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


class ProtocolConfig(SettingsFile):
    """A protocol: brackets over rings, single poses and chosen ones; rings first, in the order of the file."""

    name: Annotated[str, Field(min_length=1)] = Field(description="what the protocol is called")
    sample: str = Field(default="", description="what lies on the stage")
    bracket: BracketConfig
    rings: tuple[RingConfig, ...] = ()
    poses: tuple[PoseConfig, ...] = ()
    chosen: ChosenConfig | None = None

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
