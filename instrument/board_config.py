"""The `[[boards]]` of a rig: marker boards that lie in the sample plane."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from instrument.settings import Positive, Settings

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


class BoardConfig(Settings):
    """One marker board; lengths in millimetres, positions in the sample frame."""

    kind: Literal["charuco"] = Field(description="what is printed on the board")
    dictionary: str = Field(description="OpenCV's name of the marker dictionary")
    first_id: int = Field(ge=0, description="number of the board's first marker in the dictionary")
    squares: tuple[Squares, Squares] = Field(description="squares across and down")
    square_mm: Positive = Field(description="side of a square in mm")
    marker_mm: Positive = Field(description="side of a marker in mm, smaller than a square")
    corner_mm: tuple[float, float] = Field(description="x and y of the top left corner in mm")

    @field_validator("dictionary")
    @classmethod
    def _known_dictionary(cls, name: str) -> str:
        if name not in DICTIONARY_SIZES:
            raise ValueError(f"known dictionaries: {', '.join(DICTIONARY_SIZES)}")
        return name

    @model_validator(mode="after")
    def _printable(self) -> BoardConfig:
        misfits = [*self._marker_misfit(), *self._dictionary_misfit()]
        if misfits:
            raise ValueError("; ".join(misfits))
        return self

    def _marker_misfit(self) -> Iterator[str]:
        if self.marker_mm >= self.square_mm:
            yield (
                f"marker_mm is {self.marker_mm:g}; it must be less than square_mm ({self.square_mm:g}), "
                "for a marker lies inside a square"
            )

    def _dictionary_misfit(self) -> Iterator[str]:
        last = DICTIONARY_SIZES[self.dictionary] - 1
        if self.marker_ids[-1] > last:
            yield (
                f"first_id is {self.first_id}; with {len(self.marker_ids)} markers the board needs ids up to "
                f"{self.marker_ids[-1]}, and {self.dictionary} ends at {last}"
            )

    @property
    def marker_ids(self) -> range:
        """Ids of the markers: a ChArUco board has one in every second square."""
        return range(self.first_id, self.first_id + self.squares[0] * self.squares[1] // 2)

    @property
    def rectangle(self) -> Rectangle:
        """Left, bottom, right and top edge in mm, x right and y up."""
        left, top = self.corner_mm
        return (left, top - self.squares[1] * self.square_mm, left + self.squares[0] * self.square_mm, top)


def overlap(first: Rectangle, second: Rectangle) -> bool:
    """Whether two rectangles share more than an edge; 1e-9 mm forgives rounding of sums."""
    return all(min(first[axis + 2], second[axis + 2]) - max(first[axis], second[axis]) > 1e-9 for axis in (0, 1))
