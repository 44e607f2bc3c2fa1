"""`[response]` of a `capture.toml`: how counts that are not linear came from light."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator, model_validator

from instrument.settings import Positive, Settings


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
