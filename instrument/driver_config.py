"""What the tables `[camera.device]`, `[light.device]`, `[stage.device]` have wrong; each driver says what it takes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel, ValidationError, create_model

from drivers.driver import Kind
from drivers.errors import DeviceError, DriverNotFoundError
from drivers.registry import KINDS, check_one_world, settings_of
from instrument.config_problems import complaints, validate
from instrument.toml_lines import KeyPath


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
