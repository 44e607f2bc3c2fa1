"""What can be chosen of an export."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from instrument.files.validation import InvalidInputError, Problem, raise_if_any

TITLE = "The result cannot be exported."


@dataclass(frozen=True, slots=True)
class Crop:
    """A part of an area, in pixels from its top left.

    Attributes
    ----------
    x, y, width, height : int
    """

    x: int
    y: int
    width: int
    height: int


Target = Literal["maps", "gltf", "materialx", "usd", "mitsuba", "merl"]

Normals = Literal["opengl", "directx", "both"]

MAX_MESH = 2048
"""Most cells of a mesh along its longer side."""


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """Choices of an export.

    Attributes
    ----------
    target : Target
        What is written.
    normals : Normals, optional
        Of maps: which way green points, both by default. The other targets have a convention of their own.
    white_reflectance : float, optional
        Of what the result takes for 1; without it a scale is chosen, and stated.
    crop : Crop, optional
    resolution : int, optional
        Pixels of the longer side.
    mesh : int, optional
        Of glTF: cells of a displaced mesh along the longer side in place of a plane.

    Raises
    ------
    InvalidInputError
        If choices do not go together, or numbers are out of range.
    """

    target: Target = "maps"
    normals: Normals | None = None
    white_reflectance: float | None = None
    crop: Crop | None = None
    resolution: int | None = None
    mesh: int | None = None

    def __post_init__(self) -> None:
        raise_if_any(TITLE, self._problems())

    def _problems(self) -> Iterator[Problem]:
        if self.normals is not None and self.target != "maps":
            yield Problem("--normals", f"is for --to maps; {self.target} has a convention of its own: leave it away")
        if self.mesh is not None and self.target != "gltf":
            yield Problem("--mesh", f"is for --to gltf; {self.target} takes the displacement as a map: leave it away")
        if self.white_reflectance is not None and not 0.0 < self.white_reflectance < 1e12:
            yield Problem("--white-reflectance", f"is {self.white_reflectance:g}; must be above 0, such as 0.85")
        if self.mesh is not None and not 1 <= self.mesh <= MAX_MESH:
            yield Problem("--mesh", f"is {self.mesh}; a mesh has 1 to {MAX_MESH} cells along its longer side")
        if self.resolution is not None and self.resolution < 1:
            yield Problem("--resolution", f"is {self.resolution}; must be at least 1")


def parse_crop(text: str) -> Crop:
    """Parse ``"X,Y,WIDTH,HEIGHT"`` in pixels.

    Raises
    ------
    InvalidInputError
    """
    parts = re.fullmatch(r"\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*", text)
    numbers = [int(part) for part in parts.groups()] if parts else [0, 0, 0, 0]
    if min(numbers[2:]) < 1:
        what = f"is {text!r}; must be X,Y,WIDTH,HEIGHT in pixels from the top left, e.g. 0,0,512,512"
        raise InvalidInputError(TITLE, [Problem("--crop", what)])
    return Crop(*numbers)
