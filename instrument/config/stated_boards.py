"""The boards that a file states: a `rig.toml`, a `capture.toml`, or one of boards alone; or those to propose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from instrument.config.boards import BoardConfig
from instrument.config.capture_config import AreaTable, capture_board_misfits, load_capture
from instrument.config.loading import load_rig, load_settings, read_settings
from instrument.config.proposed_boards import PROPOSED_AREA_MM, proposed_boards
from instrument.config.tables import SettingsFile
from instrument.config.toml_lines import parse_toml
from instrument.session.records import Board


@dataclass(frozen=True, slots=True)
class StatedBoards:
    """Boards with the area that they stand around.

    Attributes
    ----------
    boards : tuple of Board
    area_mm : tuple of float or None
        Its width and height, about the origin of the sample frame.
    """

    boards: tuple[Board, ...]
    area_mm: tuple[float, float] | None


class BoardsFile(SettingsFile):
    """A file of boards alone."""

    area: AreaTable | None = None
    boards: tuple[BoardConfig, ...] = ()


def boards_to_print(path: Path | None, area_mm: tuple[float, float] | None) -> StatedBoards:
    """Return the boards of a file, or those that are proposed for an area if there is no file.

    Raises
    ------
    InvalidInputError
        With every problem of the file.
    """
    if path is not None:
        return stated_boards(path)
    area_mm = area_mm or PROPOSED_AREA_MM
    return StatedBoards(proposed_boards(area_mm), area_mm)


def stated_boards(path: Path) -> StatedBoards:
    """Read the boards of a file; which kind of file it is, its tables tell.

    Raises
    ------
    InvalidInputError
        With every problem found, each at ``file:line``.
    """
    tables = parse_toml(read_settings(path), path.name).keys()
    if tables & {"geometry", "stage"}:
        rig = load_rig(path)
        return StatedBoards(_records(rig.boards), rig.geometry.area_mm)
    config = (
        load_settings(BoardsFile, path, capture_board_misfits) if tables <= {"area", "boards"} else load_capture(path)
    )
    area = None if config.area is None else (config.area.width_mm, config.area.height_mm)
    return StatedBoards(_records(config.boards), area)


def _records(boards: tuple[BoardConfig, ...]) -> tuple[Board, ...]:
    return tuple(board.record for board in boards)
