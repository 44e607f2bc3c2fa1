"""Reads what was configured of a capture before anything was measured; what nobody gave is None."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from instrument.session import layout
from instrument.session.reader import SessionReader
from instrument.session.records import Board
from instrument.session.structure import n_boards


class NominalSetup:
    """What was configured with a capture: boards, area, lens and light, and how counts came from light.

    Parameters
    ----------
    reader : SessionReader
    """

    def __init__(self, reader: SessionReader) -> None:
        self._reader = reader

    @cached_property
    def boards(self) -> tuple[Board, ...]:
        """The boards in the sample plane."""
        return tuple(self._board(index) for index in range(n_boards(self._reader.file)))

    @cached_property
    def light_offset_mm(self) -> NDArray[np.float64] | None:
        """Nominal light position in the camera frame, shape (3,), mm; None if not given."""
        return self._reader.optional(layout.LIGHT_OFFSET)

    @cached_property
    def light_offset_sigma_mm(self) -> NDArray[np.float64] | None:
        """Standard deviation of `light_offset_mm`, shape (3,), mm; None if not given."""
        return self._reader.optional(layout.LIGHT_OFFSET_SIGMA)

    @cached_property
    def area_mm(self) -> tuple[float, float] | None:
        """Width and height of the area to reconstruct, mm; None if not given."""
        area = self._reader.optional(layout.AREA)
        return None if area is None else (float(area[0]), float(area[1]))

    @property
    def pixel_pitch_mm(self) -> float | None:
        """Wanted size of a pixel of the area, mm; None if not given."""
        return self._reader.optional_scalar(layout.PIXEL_PITCH)

    @property
    def working_distance_mm(self) -> float | None:
        """Lens to sample, nominal, mm; None if not given."""
        return self._reader.optional_scalar(layout.WORKING_DISTANCE)

    @property
    def focal_length_px(self) -> float | None:
        """Nominal focal length, pixels; None if not given."""
        return self._reader.optional_scalar(layout.FOCAL_LENGTH)

    @property
    def camera_matrix(self) -> NDArray[np.float64] | None:
        """Intrinsics as given, shape (3, 3), pixels (integer = centre of a pixel); None if not given."""
        return self._reader.optional(layout.CAMERA_MATRIX)

    @property
    def distortion(self) -> NDArray[np.float64] | None:
        """Distortion as given, shape (5,): k1, k2, p1, p2, k3 in OpenCV's order; None if not given."""
        return self._reader.optional(layout.DISTORTION)

    @property
    def black_level_cell(self) -> NDArray[np.float64] | None:
        """Black level at each place of the 2 x 2 cell, shape (2, 2), counts; None if `camera.black_level` is all."""
        return self._reader.optional(layout.BLACK_LEVEL_CELL)

    @property
    def response(self) -> NDArray[np.float32] | None:
        """Given curve of frames that are not linear, shape (1 or 3, L); None if there is none.

        Linear value of each count 0 to L - 1, 1 at the largest one; one row for all channels, or one each.
        """
        return self._reader.optional(layout.RESPONSE)

    def _board(self, index: int) -> Board:
        kind, dictionary, first_id, squares, square, marker, corner = layout.board_fields(index)
        across, down = self._reader.array(squares)
        left, top = self._reader.array(corner)
        return Board(
            kind=self._reader.text(kind),
            dictionary=self._reader.text(dictionary),
            first_id=int(self._reader.scalar(first_id)),
            squares=(int(across), int(down)),
            square_mm=self._reader.scalar(square),
            marker_mm=self._reader.scalar(marker),
            corner_mm=(float(left), float(top)),
        )
