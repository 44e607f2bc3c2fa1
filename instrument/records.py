"""Values that a session file gives back."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Board:
    """A marker board in the sample plane.

    Attributes
    ----------
    kind, dictionary : str
        ``"charuco"`` and OpenCV's name of the marker dictionary.
    first_id : int
        Number of its first marker.
    squares : tuple of int
        Squares across and down.
    square_mm, marker_mm : float
        Sides in millimetres.
    corner_mm : tuple of float
        x and y of the top left corner in the sample frame (x right, y up).
    """

    kind: str
    dictionary: str
    first_id: int
    squares: tuple[int, int]
    square_mm: float
    marker_mm: float
    corner_mm: tuple[float, float]


@dataclass(frozen=True, slots=True)
class CameraRecord:
    """The camera that took a session.

    Attributes
    ----------
    height, width : int
        Pixels of a raw frame.
    bit_depth : int
        Bits of a count, right-aligned.
    black_level, saturation_value : float
        Nominal counts of darkness and of clipping.
    bayer_pattern : str
        Colours of the 2 x 2 cell in reading order; ``""`` for monochrome.
    conversion_gain : float
        Electrons per count.
    read_noise : float
        Standard deviation of the read-out in electrons.
    """

    make: str
    model: str
    serial_number: str
    height: int
    width: int
    bit_depth: int
    black_level: float
    saturation_value: float
    bayer_pattern: str
    conversion_gain: float
    read_noise: float
