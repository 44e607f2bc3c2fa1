"""What the tables of a rig file that belong to one driver have in common."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict


class DeviceSettings(BaseModel):
    """A frozen table `[camera.device]`, `[light.device]` or `[stage.device]`.

    Each field is a key of the table, its unit at the end of its name (``_s``, ``_mm``, ``_deg``), its meaning in its
    description. Unknown keys, infinities, NaN and values of a wrong type are refused.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


SettingsOfDevice = TypeVar("SettingsOfDevice", bound=DeviceSettings)


def settings_from_table(kind: type[SettingsOfDevice], table: Mapping[str, Any]) -> SettingsOfDevice:
    """Return settings from a parsed table of TOML.

    By way of JSON, because only there does pydantic's strict mode take a list for a tuple while it still refuses a
    text or a boolean for a number.

    Raises
    ------
    pydantic.ValidationError
        With everything that is wrong.
    """
    return kind.model_validate_json(json.dumps(table), strict=True)
