"""Reads `rig.toml` and `protocol.toml`; finds everything that is wrong with them before anything moves."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from instrument.board_config import BoardConfig
from instrument.config_problems import complaints, valid_or_none, validate
from instrument.protocol_config import ProtocolConfig
from instrument.rig_config import GeometryConfig, RigConfig, rig_misfits
from instrument.settings import SettingsFile
from instrument.toml_lines import KeyPath, TomlLines, parse_toml
from instrument.validation import InvalidInputError, Problem

__all__ = ["ProtocolConfig", "RigConfig", "load_protocol", "load_rig"]

Config = TypeVar("Config", bound=SettingsFile)

# A configuration is a page or two; a larger file is some other file.
MAX_BYTES = 1_000_000


def load_rig(path: Path | str) -> RigConfig:
    """Read a rig's configuration.

    Raises
    ------
    InvalidInputError
        With every problem found, each at ``file:line``.
    """
    return _load(RigConfig, Path(path))


def load_protocol(path: Path | str) -> ProtocolConfig:
    """Read a protocol.

    Raises
    ------
    InvalidInputError
        With every problem found, each at ``file:line``.
    """
    return _load(ProtocolConfig, Path(path))


def _load(model: type[Config], path: Path) -> Config:
    text = _read(path)
    data = parse_toml(text, path.name)
    try:
        config = validate(model, data)
    except ValidationError as error:
        raise InvalidInputError(f"{path} cannot be used", _problems(model, error, data, text, path)) from None
    config.remember(text)
    return config


def _read(path: Path) -> str:
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        why = f"cannot be read: {error.strerror}"
        raise InvalidInputError(f"{path} cannot be used", [Problem(str(path), why)]) from None
    if len(content) > MAX_BYTES:
        why = f"is larger than {MAX_BYTES} bytes; is it the right file?"
        raise InvalidInputError(f"{path} cannot be used", [Problem(str(path), why)])
    return _decode(content, path)


def _decode(content: bytes, path: Path) -> str:
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        why = f"byte 0x{content[error.start]:02x} is not UTF-8; save the file with that encoding"
        raise InvalidInputError(f"{path} cannot be used", [Problem(f"{path.name}:{line}", why)]) from None


def _problems(
    model: type[SettingsFile], error: ValidationError, data: dict[str, Any], text: str, path: Path
) -> list[Problem]:
    lines = TomlLines(text)
    found = [*complaints(model, error), *(_misfits(data) if model is RigConfig else ())]
    # What the rig's tables have against each other arrives one by one with a line of its own.
    placed = [entry for entry in found if entry[0] or model is not RigConfig]
    at = [(lines.line(key), what) for key, what in placed]
    return [Problem(f"{path.name}:{line}", what) for line, what in sorted(at)]


def _misfits(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    tables = data.get("boards")
    boards = [valid_or_none(BoardConfig, table) for table in tables] if isinstance(tables, list) else []
    well_formed = {i: board for i, board in enumerate(boards) if board is not None}
    return rig_misfits(well_formed, valid_or_none(GeometryConfig, data.get("geometry")))
