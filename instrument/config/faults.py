"""The values of a fault script: which call of which simulated device goes wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from drivers.simulated.faults import EFFECTS, Fault
from instrument.config.loading import load_settings
from instrument.config.tables import NonNegative, Settings, SettingsFile


class FaultConfig(Settings):
    """One of `[[faults]]`."""

    device: Literal["camera", "light", "stage"] = Field(description="whose call goes wrong")
    effect: str = Field(description="what happens")
    call: str = Field(default="", description="which method, e.g. trigger, on, off, move; any if not given")
    at: int = Field(default=0, ge=0, description="at the how-manieth such call, from 0")
    after_s: NonNegative | None = Field(default=None, description="seconds of the rig's clock, in place of at")
    repeats: int = Field(default=1, ge=0, description="how many such calls in a row; 0 = all from then on")
    value: float = Field(default=0.1, description="size of an effect that has one")

    @model_validator(mode="after")
    def _known_effect(self) -> FaultConfig:
        known = EFFECTS[self.device]
        if self.effect not in known:
            raise ValueError(f"effect is {self.effect!r}; a {self.device} knows {', '.join(known)}")
        return self


class FaultsConfig(SettingsFile):
    """A fault script."""

    faults: tuple[FaultConfig, ...] = Field(min_length=1, description="one table each")


def load_faults(path: Path | str) -> tuple[Fault, ...]:
    """Read a fault script.

    Raises
    ------
    InvalidInputError
        With every problem found, each at ``file:line``.
    """
    script = load_settings(FaultsConfig, Path(path))
    return tuple(
        Fault(fault.device, fault.effect, fault.call, fault.at, fault.after_s, fault.repeats, fault.value)
        for fault in script.faults
    )
