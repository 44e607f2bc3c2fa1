"""From a table of the rig file to the frozen settings of a driver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar, get_type_hints

from drivers.errors import DeviceError

Settings = TypeVar("Settings")


def settings_from_table(kind: type[Settings], table: Mapping[str, Any], where: str) -> Settings:
    """Return a frozen dataclass from a table; keys that are missing keep their defaults.

    Parameters
    ----------
    kind : type
        A dataclass.
    table : mapping
        Values by field.
    where : str
        Name of the table in the rig file, for the message.

    Raises
    ------
    DeviceError
        Names every key that is unknown, missing or of another type, or what the dataclass says of a value.
    """
    members = fields(kind)  # type: ignore[arg-type]
    allowed = {member.name for member in members}
    needed = {m.name for m in members if m.default is MISSING and m.default_factory is MISSING}
    problems = [f"{where} has no key {key!r}" for key in sorted(set(table) - allowed)]
    problems += [f"{where}.{key} is missing" for key in sorted(needed - set(table))]
    problems += _of_another_type(kind, table, where)
    if problems:
        raise DeviceError(f"{'; '.join(problems)}. Allowed are {', '.join(sorted(allowed))}.")
    try:
        return kind(**table)
    except ValueError as error:
        raise DeviceError(f"{where}: {error}") from None


def _of_another_type(kind: type[Any], table: Mapping[str, Any], where: str) -> list[str]:
    hints = get_type_hints(kind)
    return [
        f"{where}.{key} is {value!r}; expected was a value of type {hints[key].__name__}"
        for key, value in table.items()
        if key in hints and not _is_a(value, hints[key])
    ]


def _is_a(value: Any, hint: type[Any]) -> bool:
    """Tell whether a value of TOML may stand for `hint`: 1 is a float too, and true is no number."""
    if isinstance(value, bool):
        return hint is bool
    return isinstance(value, (int, float) if hint is float else hint)
