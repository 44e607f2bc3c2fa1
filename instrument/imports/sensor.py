"""The camera of an import: what the files say, completed and corrected by `capture.toml`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf, nan

import numpy as np
from numpy.typing import NDArray

from instrument.config.capture_config import CameraTable
from instrument.imports.arrangement import Frame
from instrument.session.records import CameraRecord

WORD = 16


@dataclass(frozen=True)
class Sensor:
    """How counts of the files become those of the session, and what they mean there.

    Attributes
    ----------
    camera : CameraRecord
    shift : int
        Bits by which counts are shifted down.
    black_level : tuple of float
        At the four places of the cell in reading order.
    notes : tuple of str
        What was assumed.
    """

    camera: CameraRecord
    shift: int
    black_level: tuple[float, ...]
    notes: tuple[str, ...]

    @property
    def black_level_cell(self) -> NDArray[np.float64] | None:
        """Black level at each place of the cell, shape (2, 2); None if it is the same everywhere."""
        return None if len(set(self.black_level)) == 1 else np.reshape(self.black_level, (2, 2))


def sensor_of(table: CameraTable, frames: Sequence[Frame], all_bits: int) -> Sensor:
    """Return the camera that took `frames`; `all_bits` are set in at least one pixel of any picture.

    Raises
    ------
    ValueError
        If what is stated contradicts the files.
    """
    first, shot = frames[0].surveyed, frames[0].surveyed.shot
    if table.bayer_pattern and len(first.shape) == 3:
        raise ValueError("bayer_pattern is stated, but every pixel of the pictures holds three colours; leave it out")
    shift = shift_of(all_bits, table.bit_depth) if first.dtype == "u2" else 0
    depth = _bit_depth(table, frames, all_bits, shift)
    black = _black_level(table, frames, shift)
    white = _saturation_level(table, frames, shift, depth)
    if max(black) >= white:
        raise ValueError(f"black_level is {max(black):g} and saturation_level {white:g}; black must be less")
    camera = CameraRecord(
        make=shot.make if table.make is None else table.make,
        model=shot.model if table.model is None else table.model,
        serial_number=shot.serial_number if table.serial_number is None else table.serial_number,
        height=first.shape[0],
        width=first.shape[1],
        n_channels=3 if len(first.shape) == 3 else 1,
        dtype="f4" if first.dtype == "f4" else "u2",
        bit_depth=depth,
        black_level=float(np.mean(black)),
        saturation_value=white,
        bayer_pattern=(first.bayer_pattern or "") if table.bayer_pattern is None else table.bayer_pattern,
        conversion_gain=nan if table.conversion_gain is None else table.conversion_gain,
        read_noise=nan if table.read_noise is None else table.read_noise,
    )
    return Sensor(camera, shift, black, tuple(_notes(table, frames, camera)))


def _bit_depth(table: CameraTable, frames: Sequence[Frame], all_bits: int, shift: int) -> int:
    first = frames[0].surveyed
    if first.dtype != "u2":
        return {"u1": 8, "f4": 32}[first.dtype]
    if table.bit_depth is not None:
        return table.bit_depth
    stated = first.saturation_level
    return guessed_depth(all_bits, shift) if stated is None else max((int(stated) >> shift).bit_length(), 1)


def _black_level(table: CameraTable, frames: Sequence[Frame], shift: int) -> tuple[float, ...]:
    if table.black_level is not None:
        return table.black_level * (4 // len(table.black_level))
    stated = _stated_blacks(frames)
    return (0.0,) * 4 if stated is None else tuple(np.median(stated, axis=0) / 2**shift)


def _stated_blacks(frames: Sequence[Frame]) -> NDArray[np.float64] | None:
    """Return the black levels that the files state, shape (n_files, 4), in their own units; None if they do not."""
    levels = [frame.surveyed.black_level for frame in frames if frame.surveyed.black_level is not None]
    return np.array(levels) if levels else None


def _saturation_level(table: CameraTable, frames: Sequence[Frame], shift: int, depth: int) -> float:
    first = frames[0].surveyed
    if table.saturation_level is not None:
        return table.saturation_level
    if first.saturation_level is not None:
        return float(int(first.saturation_level) >> shift)
    return inf if first.dtype == "f4" else float(2**depth - 1)


def _notes(table: CameraTable, frames: Sequence[Frame], camera: CameraRecord) -> Iterator[str]:
    first = frames[0].surveyed
    if first.dtype == "u2" and first.saturation_level is None and table.bit_depth is None:
        yield f"counts are taken to be {camera.bit_depth} bits deep; state bit_depth in [camera] if they are not"
    if first.dtype == "u2" and first.black_level is None and table.black_level is None:
        yield "the black level is taken to be 0; state black_level in [camera], or add [darks], if it is not"
    stated = _stated_blacks(frames)
    if table.black_level is None and stated is not None and (np.ptp(stated, axis=0) > 0).any():
        yield f"the pictures state black levels from {stated.min():g} to {stated.max():g}; the medians are used"
    automatic = sum(frame.surveyed.shot.white_balance.lower().startswith("auto") for frame in frames)
    if automatic and camera.n_channels == 3:
        yield f"{automatic} pictures have an automatic white balance: colours may differ from pose to pose"
    if first.bayer_pattern is None and table.bayer_pattern is None and camera.n_channels == 1:
        yield "frames are taken to be monochrome; state bayer_pattern in [camera] if they are a mosaic"


def shift_of(any_bits: int, bit_depth: int | None) -> int:
    """Return by how many bits counts must be shifted down to be right-aligned.

    Parameters
    ----------
    any_bits : int
        Bits that are set in at least one pixel of any picture; real counts leave none of theirs unused.
    bit_depth : int or None
        Bits of a count, if that is stated.

    Raises
    ------
    ValueError
        If counts of `bit_depth` bits cannot look like this.
    """
    unused = (any_bits & -any_bits).bit_length() - 1 if any_bits else 0
    if bit_depth is None:
        # Converters have 8, 10, 12 or 14 bits; a single low bit that is never set is chance, not alignment.
        return min(unused - unused % 2, WORD - 8)
    if any_bits < 1 << bit_depth:
        return 0
    if unused < WORD - bit_depth:
        raise ValueError(
            f"bit_depth is {bit_depth}, but the pictures hold counts up to {any_bits.bit_length()} bits and use "
            f"all but the lowest {unused}; are they {max(any_bits.bit_length() - unused, 8)} bits deep?"
        )
    return WORD - bit_depth


def guessed_depth(any_bits: int, shift: int) -> int:
    """Return the smallest usual bit depth that holds counts with `any_bits`, before `shift`."""
    if shift:
        return WORD - shift
    return next(depth for depth in (10, 12, 14, WORD) if any_bits < 1 << depth)
