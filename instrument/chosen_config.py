"""The values of `[chosen]` in `protocol.toml`: poses that are chosen for what they tell."""

from __future__ import annotations

from pydantic import Field

from instrument.settings import Settings


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
