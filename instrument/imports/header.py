"""The header of an imported session, from the pictures that have been surveyed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instrument.config.capture_config import CaptureConfig, IntrinsicsTable
from instrument.imports.arrangement import Arrangement, Frame
from instrument.imports.prepare import Import
from instrument.recording.header import Provenance, SessionHeader
from instrument.session import layout
from instrument.session.layout import Field
from instrument.session.records import Geometry


def session_header(prepared: Import) -> SessionHeader:
    """Return what the session of an import holds before its first picture."""
    config, arrangement, plan = prepared.config, prepared.arrangement, prepared.arrangement.plan
    shape = prepared.sensor.camera.frame_shape
    return SessionHeader(
        title=config.name,
        sample=config.sample,
        description=f"{config.name}: {config.sample or 'a sample'}, pictures from elsewhere",
        plan_json=plan.json,
        plan_sha256=plan.sha256,
        n_poses=len(arrangement.poses),
        exposure_times=arrangement.exposure_times,
        camera=prepared.sensor.camera,
        geometry=_geometry(config),
        boards=tuple(board.record for board in config.boards),
        provenance=Provenance(config.text),
        has_darks=bool(arrangement.darks),
        optional=dict(_optional(prepared)),
        empty={field: (len(frames), *shape) for field, frames in pictures_beside(arrangement).items() if frames},
    )


def _geometry(config: CaptureConfig) -> Geometry:
    light, area = config.light, config.area
    sigma = None if light is None else light.offset_sigma_mm
    return Geometry(
        area_mm=None if area is None else (area.width_mm, area.height_mm),
        working_distance_mm=config.working_distance_mm,
        focal_length_px=config.focal_length_px or _mean_focal_length(config.intrinsics),
        light_offset_mm=None if light is None else light.offset_mm,
        light_offset_sigma_mm=None if sigma is None else (sigma, sigma, sigma),
    )


def _mean_focal_length(intrinsics: IntrinsicsTable | None) -> float | None:
    return None if intrinsics is None else (intrinsics.fx + intrinsics.fy) / 2


def _optional(prepared: Import) -> Iterator[tuple[Field, Any]]:
    config, arrangement = prepared.config, prepared.arrangement
    yield layout.BLACK_LEVEL_CELL, prepared.sensor.black_level_cell
    yield layout.RESPONSE, prepared.response
    if config.area is not None:
        yield layout.PIXEL_PITCH, config.area.pitch_mm
    if config.intrinsics is not None:
        yield layout.CAMERA_MATRIX, _camera_matrix(config.intrinsics)
        yield layout.DISTORTION, np.pad(config.intrinsics.distortion, (0, 5 - len(config.intrinsics.distortion)))
    if arrangement.ambient:
        yield layout.AMBIENT_TIME, _times(arrangement.ambient)
        yield layout.AMBIENT_OF_POSE, arrangement.ambient_of_pose
    if arrangement.flats:
        yield layout.FLAT_TIME, _times(arrangement.flats)
        yield layout.FLAT_DISTANCE, arrangement.flat_distances
    if arrangement.response:
        yield layout.RESPONSE_TIME, _times(arrangement.response)


def _camera_matrix(lens: IntrinsicsTable) -> NDArray[np.float64]:
    return np.array([[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]])


def _times(frames: Sequence[Frame]) -> list[float]:
    return [frame.exposure_time for frame in frames]


def pictures_beside(arrangement: Arrangement) -> dict[Field, Sequence[Frame]]:
    """Return the pictures beside those of the poses, by the field that holds them."""
    return {
        layout.AMBIENT_IMAGES: arrangement.ambient,
        layout.FLAT_IMAGES: arrangement.flats,
        layout.RESPONSE_IMAGES: arrangement.response,
    }
