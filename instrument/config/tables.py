"""What every table of a configuration file has in common."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, Field

from drivers.device_settings import DeviceSettings

Positive = Annotated[float, Field(gt=0)]

NonNegative = Annotated[float, Field(ge=0)]

Vector = tuple[float, float, float]


class Settings(BaseModel):
    """A frozen table: unknown keys, infinities, NaN and values of a wrong type are refused."""

    model_config = DeviceSettings.model_config


class SettingsFile(Settings):
    """A whole file, which remembers the text it was read from."""

    _text: str = ""

    @property
    def text(self) -> str:
        """The file as its author wrote it; JSON of the values where there was no file."""
        return self._text or self.model_dump_json(indent=2)

    def remember(self, text: str) -> None:
        """Keep the text that the values were read from, for provenance."""
        self._text = text
