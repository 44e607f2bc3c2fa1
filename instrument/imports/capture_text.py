"""The `capture.toml` of an exported session: all that its pictures do not hold exactly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

import numpy as np

from instrument.config.toml_text import board_lines, key_lines, table_lines
from instrument.session.session import Session


@dataclass(frozen=True, slots=True)
class Beside:
    """Names of pictures and their exposure times in seconds."""

    files: tuple[str, ...]
    times: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written of a session.

    Attributes
    ----------
    poses : tuple of Beside
        The bracket of each pose.
    ambient : tuple of (str or None)
        The picture without the light of each pose.
    darks, flats, response : Beside or None
    curve : str or None
        File of a given response curve.
    """

    poses: tuple[Beside, ...]
    ambient: tuple[str | None, ...]
    darks: Beside | None
    flats: Beside | None
    response: Beside | None
    curve: str | None


def capture_text(session: Session, exported: Exported) -> str:
    """Return the `capture.toml` of a session that was exported."""
    parts = (_head(session, exported), _camera(session), _lens(session), _light_and_area(session))
    beside = (_response(exported), _beside(session, exported), _boards(session), _poses(exported))
    return "\n".join(line for part in (*parts, *beside) for line in part) + "\n"


def _head(session: Session, exported: Exported) -> Iterator[str]:
    linear = exported.curve is None and exported.response is None
    yield from key_lines(name=session.title or "a session", sample=session.sample, linear=linear)
    yield from key_lines(working_distance_mm=session.nominal.working_distance_mm)
    if session.nominal.camera_matrix is None:
        yield from key_lines(focal_length_px=session.nominal.focal_length_px)


def _camera(session: Session) -> Iterator[str]:
    camera, cell = session.camera, session.nominal.black_level_cell
    yield from table_lines("camera", make=camera.make, model=camera.model, serial_number=camera.serial_number)
    yield from key_lines(
        bayer_pattern=camera.bayer_pattern,
        bit_depth=camera.bit_depth if camera.dtype == "u2" and 8 <= camera.bit_depth <= 16 else None,
        black_level=camera.black_level if cell is None else cell.ravel().tolist(),
        saturation_level=camera.saturation_value,
        conversion_gain=camera.conversion_gain,
        read_noise=camera.read_noise,
    )


def _lens(session: Session) -> Iterator[str]:
    matrix, distortion = session.nominal.camera_matrix, session.nominal.distortion
    if matrix is not None:
        yield from table_lines("intrinsics", fx=matrix[0, 0], fy=matrix[1, 1], cx=matrix[0, 2], cy=matrix[1, 2])
        yield from key_lines(distortion=None if distortion is None else distortion.tolist())


def _light_and_area(session: Session) -> Iterator[str]:
    offset, sigma, area = (
        session.nominal.light_offset_mm,
        session.nominal.light_offset_sigma_mm,
        session.nominal.area_mm,
    )
    if offset is not None and sigma is not None:
        yield from table_lines("light", offset_mm=offset.tolist(), offset_sigma_mm=float(np.max(sigma)))
    if area is not None:
        yield from table_lines("area", width_mm=area[0], height_mm=area[1], pitch_mm=session.nominal.pixel_pitch_mm)


def _response(exported: Exported) -> Iterator[str]:
    if exported.curve is not None:
        yield from table_lines("response", curve=exported.curve)
    elif exported.response is not None:
        yield from table_lines("response.bracket", files=exported.response.files, times_s=exported.response.times)


def _beside(session: Session, exported: Exported) -> Iterator[str]:
    if exported.darks is not None:
        yield from table_lines("darks", files=exported.darks.files, exposure_times_s=exported.darks.times)
    if exported.flats is not None:
        distances = session.extra.flat_distances_mm.tolist()
        yield from table_lines("flats", files=exported.flats.files, exposure_times_s=exported.flats.times)
        yield from key_lines(distance_mm=distances if all(map(isfinite, distances)) else None)


def _boards(session: Session) -> Iterator[str]:
    for board in session.nominal.boards:
        yield from board_lines(board)


def _poses(exported: Exported) -> Iterator[str]:
    for pose, ambient in zip(exported.poses, exported.ambient, strict=True):
        yield from table_lines("[poses]", files=pose.files, exposure_times_s=pose.times)
        yield from key_lines(ambient=None if ambient is None else [ambient])
