"""Reads `rig.toml` and `protocol.toml`; finds everything that is wrong with them before anything moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from drivers.registry import SIMULATED
from instrument.config.boards import BoardConfig
from instrument.config.messages import complaints, valid_or_none, validate
from instrument.config.protocol import ProtocolConfig
from instrument.config.rig import GeometryConfig, RigConfig, drivers_named, rig_misfits
from instrument.config.tables import SettingsFile
from instrument.config.toml_lines import KeyPath, TomlLines, parse_toml
from instrument.files.validation import InvalidInputError, Problem, raise_if_any

__all__ = ["ProtocolConfig", "RigConfig", "load_protocol", "load_rig"]

Config = TypeVar("Config", bound=SettingsFile)

Misfits = Callable[[dict[str, Any]], Iterator[tuple[KeyPath, str]]]

# A configuration is a page or two; a larger file is some other file.
MAX_BYTES = 1_000_000

# More than that nobody reads.
MAX_PROBLEMS = 100


def load_rig(path: Path | str) -> RigConfig:
    """Read a rig's configuration.

    Raises
    ------
    InvalidInputError
        With every problem found, each at ``file:line``.
    """
    return load_settings(RigConfig, Path(path), _rig_misfits)


def load_protocol(path: Path | str) -> ProtocolConfig:
    """Read a protocol.

    Raises
    ------
    InvalidInputError
        With every problem found, each at ``file:line``.
    """
    protocol = load_settings(ProtocolConfig, Path(path))
    kept = protocol.darks_and_flats
    if kept is None:
        return protocol
    beside = kept.model_copy(update={"session": str(Path(path).parent / kept.session)})
    return protocol.model_copy(update={"darks_and_flats": beside})


def load_settings(model: type[Config], path: Path, misfits: Misfits | None = None) -> Config:
    """Read a file of settings.

    Parameters
    ----------
    model : type
        Of what it holds.
    path : Path
    misfits : callable, optional
        Takes the parsed file and yields what its tables have against each other, each with the path of a key;
        it replaces what `model` itself says of the file as a whole.

    Raises
    ------
    InvalidInputError
        With every problem found, each at ``file:line``.
    """
    return settings_from_text(model, read_settings(path), path, misfits)


def settings_from_text(model: type[Config], text: str, path: Path, misfits: Misfits | None = None) -> Config:
    """Take settings from a text, as `load_settings` does from a file; `path` is what messages call it."""
    data = parse_toml(text, path.name)
    found = [*_complaints(model, data, misfits is None), *(misfits(data) if misfits else ())]
    lines = TomlLines(text)
    at = sorted((lines.line(key), what) for key, what in found)
    problems = [Problem(f"{path.name}:{line}", what) for line, what in at[:MAX_PROBLEMS]]
    if len(at) > MAX_PROBLEMS:
        problems.append(Problem(path.name, f"and {len(at) - MAX_PROBLEMS} more; is it the right file?"))
    raise_if_any(f"{path} cannot be used", problems)
    config = validate(model, data)
    config.remember(text)
    return config


def _complaints(
    model: type[SettingsFile], data: dict[str, Any], with_those_of_the_whole: bool
) -> Iterator[tuple[KeyPath, str]]:
    try:
        validate(model, data)
    except ValidationError as error:
        yield from ((key, what) for key, what in complaints(model, error) if key or with_those_of_the_whole)


def read_settings(path: Path) -> str:
    """Return the text of a file of settings.

    Raises
    ------
    InvalidInputError
        If it cannot be read, is no text, or is too large to be one.
    """
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


def _rig_misfits(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    if "simulation" in data and SIMULATED not in drivers_named(data).values():
        yield ("simulation",), "the table [simulation] is for simulated devices, and these are real; remove it"
    tables = data.get("boards")
    boards = [valid_or_none(BoardConfig, table) for table in tables] if isinstance(tables, list) else []
    well_formed = {i: board for i, board in enumerate(boards) if board is not None}
    yield from rig_misfits(data, well_formed, valid_or_none(GeometryConfig, data.get("geometry")))
