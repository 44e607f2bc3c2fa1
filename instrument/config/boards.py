"""The `[[boards]]` of a rig or of pictures from elsewhere: they lie in the sample plane."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from math import nan
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from instrument.config.tables import NonNegative, Positive, Settings
from instrument.config.toml_lines import KeyPath
from instrument.session.records import Board

# How many markers OpenCV's predefined dictionaries hold; a test compares them with OpenCV's own.
DICTIONARY_SIZES = {
    **{f"DICT_{bits}X{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "DICT_ARUCO_ORIGINAL": 1024,
    "DICT_APRILTAG_16h5": 30,
    "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320,
    "DICT_APRILTAG_36h11": 587,
    "DICT_ARUCO_MIP_36h12": 250,
}

Squares = Annotated[int, Field(ge=2, le=100)]

Rectangle = tuple[float, float, float, float]

MARKER_KEYS = ("dictionary", "first_id", "marker_mm")


class BoardConfig(Settings):
    """One board; lengths in millimetres, positions in the sample frame."""

    kind: Literal["charuco", "checkerboard"] = Field(description="what is printed on the board")
    dictionary: str = Field(default="", description="OpenCV's name of the marker dictionary")
    first_id: int = Field(default=0, ge=0, description="number of the board's first marker in the dictionary")
    squares: tuple[Squares, Squares] = Field(description="squares across and down")
    square_mm: Positive = Field(description="side of a square in mm")
    marker_mm: NonNegative = Field(default=0.0, description="side of a marker in mm, smaller than a square")
    corner_mm: tuple[float, float] | None = Field(description='x and y of the top left corner in mm, or "measure"')

    @field_validator("corner_mm", mode="before")
    @classmethod
    def _measured_later(cls, corner: object) -> object:
        # After a validator of ours pydantic no longer takes a list for a tuple.
        return None if corner == "measure" else tuple(corner) if isinstance(corner, list) else corner

    @field_validator("dictionary")
    @classmethod
    def _known_dictionary(cls, name: str) -> str:
        if name and name not in DICTIONARY_SIZES:
            raise ValueError(f"known dictionaries: {', '.join(DICTIONARY_SIZES)}")
        return name

    @model_validator(mode="after")
    def _printable(self) -> BoardConfig:
        misfits = tuple(self._missing_keys() if self.kind == "charuco" else self._keys_of_a_charuco_board())
        misfits = misfits or tuple(self._marker_misfits())
        if misfits:
            raise ValueError("; ".join(misfits))
        return self

    def _missing_keys(self) -> Iterator[str]:
        missing = [key for key in MARKER_KEYS if key not in self.model_fields_set]
        if missing:
            yield f"a charuco board has markers; add {', '.join(missing)}"

    def _keys_of_a_charuco_board(self) -> Iterator[str]:
        needless = [key for key in MARKER_KEYS if getattr(self, key)]
        if needless:
            yield f'a checkerboard has no markers; leave out {", ".join(needless)}, or is its kind "charuco"?'

    def _marker_misfits(self) -> Iterator[str]:
        if self.kind == "charuco":
            yield from self._marker_size_misfit()
            yield from self._dictionary_misfit()

    def _marker_size_misfit(self) -> Iterator[str]:
        if self.marker_mm >= self.square_mm:
            yield (
                f"marker_mm is {self.marker_mm:g}; it must be less than square_mm ({self.square_mm:g}), "
                "for a marker lies inside a square"
            )
        if self.marker_mm == 0:
            yield "marker_mm is 0; it must be greater than 0"

    def _dictionary_misfit(self) -> Iterator[str]:
        last = DICTIONARY_SIZES.get(self.dictionary, 0) - 1
        if self.marker_ids[-1] > last:
            yield (
                f"first_id is {self.first_id}; with {len(self.marker_ids)} markers the board needs ids up to "
                f"{self.marker_ids[-1]}, and {self.dictionary} ends at {last}"
            )

    @property
    def marker_ids(self) -> range:
        """Ids of the markers: a ChArUco board has one in every second square, a checkerboard none."""
        if self.kind == "checkerboard":
            return range(0)
        return range(self.first_id, self.first_id + self.squares[0] * self.squares[1] // 2)

    @property
    def rectangle(self) -> Rectangle | None:
        """Left, bottom, right and top edge in mm, x right and y up; None if that is to be measured."""
        if self.corner_mm is None:
            return None
        left, top = self.corner_mm
        return (left, top - self.squares[1] * self.square_mm, left + self.squares[0] * self.square_mm, top)

    @property
    def record(self) -> Board:
        """The board as a session holds it."""
        corner = (nan, nan) if self.corner_mm is None else self.corner_mm
        return Board(**{**dict(self), "corner_mm": corner})


def overlap(first: Rectangle | None, second: Rectangle | None) -> bool:
    """Whether two rectangles share more than an edge; 1e-9 mm forgives rounding of sums; an unknown one does not."""
    if first is None or second is None:
        return False
    return all(min(first[axis + 2], second[axis + 2]) - max(first[axis], second[axis]) > 1e-9 for axis in (0, 1))


def board_misfits(
    boards: Mapping[int, BoardConfig], area: Rectangle | None, area_key: str
) -> Iterator[tuple[KeyPath, str]]:
    """Yield where and why boards do not fit each other or the area, which `area_key` of the file states.

    It takes those that are well formed by themselves, so that a mistake in one table does not hide
    another one between two others.
    """
    for i, board in boards.items():
        if overlap(board.rectangle, area):
            yield _at(i, "corner_mm", f"{_box(board)}, which overlaps {area_key}; move it outside")
    for (i, first), (j, second) in combinations(boards.items(), 2):
        if overlap(first.rectangle, second.rectangle):
            yield _at(j, "corner_mm", f"{_box(second)}, which overlaps boards[{i}] ({_box(first)})")
        yield from _shared_markers(i, first, j, second)


def _shared_markers(i: int, first: BoardConfig, j: int, second: BoardConfig) -> Iterator[tuple[KeyPath, str]]:
    shared = sorted(set(first.marker_ids) & set(second.marker_ids))
    if shared and first.dictionary == second.dictionary:
        yield _at(
            j,
            "first_id",
            f"the board's marker ids {second.marker_ids[0]} to {second.marker_ids[-1]} overlap those of "
            f"boards[{i}] ({first.marker_ids[0]} to {first.marker_ids[-1]}); "
            f"the next free id after that board is {first.marker_ids[-1] + 1}",
        )


def _at(i: int, key: str, text: str) -> tuple[KeyPath, str]:
    return ("boards", i, key), f"boards[{i}].{key}: {text}"


def _box(board: BoardConfig) -> str:
    left, bottom, right, top = board.rectangle or (nan,) * 4
    return f"the board covers x {left:g} to {right:g}, y {bottom:g} to {top:g} mm"
