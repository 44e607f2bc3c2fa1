"""The header of a session: all that is known before its first pose, as plain values."""

from __future__ import annotations

import json
import platform
import uuid
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np

from drivers.stage import AxisDescription
from instrument.files.digests import text_digest
from instrument.session import layout
from instrument.session.layout import Field
from instrument.session.records import Board, CameraRecord, Geometry


@dataclass(frozen=True, slots=True)
class Provenance:
    """The texts that a session was made from; an import has no rig.

    Attributes
    ----------
    protocol_text : str
        `protocol.toml`, or the `capture.toml` of an import, to the letter.
    rig_text, rig_json : str or None
        `rig.toml`, and its values with every default filled in.
    firmware : mapping of str to str
        Of each device, as it says itself.
    sources : mapping of str to str
        Digest of each file that it was calibrated with, by what it is.
    """

    protocol_text: str
    rig_text: str | None = None
    rig_json: str | None = None
    firmware: Mapping[str, str] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SessionHeader:
    """What a session file holds from the start and never changes.

    Attributes
    ----------
    title, sample, description : str
        Name of the protocol or of the import, what was captured, and both in a sentence.
    plan_json, plan_sha256 : str
        The plan in canonical form and the digest of exactly that text.
    n_poses : int
        P.
    exposure_times : tuple of float, length E
        Seconds, ascending.
    camera : CameraRecord
    geometry : Geometry
    boards : tuple of Board
    provenance : Provenance
    light_type, light_serial, stage_serial : str
        Empty where nobody knows.
    axes : tuple of AxisDescription
        Of the stage.
    targets : mapping of str to tuple of float, length P
        Wanted position of each axis at each pose, in degrees or millimetres.
    has_darks : bool
        Whether there will be dark frames.
    optional : mapping of Field to array
        Further fields of the layout that are known now.
    empty : mapping of Field to tuple of int
        Further fields that are filled later, with their shapes.
    """

    title: str
    sample: str
    description: str
    plan_json: str
    plan_sha256: str
    n_poses: int
    exposure_times: tuple[float, ...]
    camera: CameraRecord
    geometry: Geometry
    boards: tuple[Board, ...]
    provenance: Provenance
    light_type: str = ""
    light_serial: str = ""
    stage_serial: str = ""
    axes: tuple[AxisDescription, ...] = ()
    targets: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    has_darks: bool = False
    optional: Mapping[Field, Any] = field(default_factory=dict)
    empty: Mapping[Field, tuple[int, ...]] = field(default_factory=dict)


def known_values(header: SessionHeader, now: str) -> dict[Field, Any]:
    """Return the content of every dataset that does not wait for a frame; `now` is ISO 8601."""
    values = {
        **_entry_values(header, now),
        **_device_values(header),
        **_geometry_values(header.geometry),
        **_provenance(header.provenance, now),
        **header.optional,
    }
    return {field: value for field, value in values.items() if value is not None}


def _entry_values(header: SessionHeader, now: str) -> dict[Field, Any]:
    return {
        layout.TITLE: header.title,
        layout.START_TIME: now,
        layout.END_TIME: "",
        layout.UUID: str(uuid.uuid4()),
        layout.DESCRIPTION: header.description,
        layout.STATUS: layout.Status.RECORDING,
        layout.SAMPLE_NAME: header.sample,
        layout.PLAN_JSON: header.plan_json,
        layout.PLAN_SHA256: header.plan_sha256,
        layout.ORDER: np.arange(header.n_poses),
        layout.COUNT_TIME: header.exposure_times,
    }


def _device_values(header: SessionHeader) -> dict[Field, Any]:
    camera = header.camera
    return {
        layout.MAKE: camera.make,
        layout.MODEL: camera.model,
        layout.SERIAL: camera.serial_number,
        layout.BIT_DEPTH: camera.bit_depth,
        layout.BLACK_LEVEL: camera.black_level,
        layout.SATURATION: camera.saturation_value,
        layout.CONVERSION_GAIN: camera.conversion_gain,
        layout.READ_NOISE: camera.read_noise,
        layout.BAYER_PATTERN: camera.bayer_pattern,
        layout.LIGHT_TYPE: header.light_type,
        layout.LIGHT_SERIAL: header.light_serial,
        layout.STAGE_SERIAL: header.stage_serial,
        layout.BOARDS_JSON: json.dumps([_board_values(board) for board in header.boards]),
    }


def _board_values(board: Board) -> dict[str, Any]:
    """Return a board for JSON, which has no NaN."""
    return asdict(board) if board.is_placed else {**asdict(board), "corner_mm": None}


def _geometry_values(geometry: Geometry) -> dict[Field, Any]:
    return {
        layout.AREA: geometry.area_mm,
        layout.WORKING_DISTANCE: geometry.working_distance_mm,
        layout.FOCAL_LENGTH: geometry.focal_length_px,
        layout.LIGHT_OFFSET: geometry.light_offset_mm,
        layout.LIGHT_OFFSET_SIGMA: geometry.light_offset_sigma_mm,
    }


def _provenance(texts: Provenance, now: str) -> dict[Field, Any]:
    packages = {name: version(name) for name in ("numpy", "h5py", "hdf5plugin")}
    return {
        layout.PROGRAM: "halfangle",
        layout.PROGRAM_VERSION: version("halfangle"),
        layout.DATE: now,
        layout.SEQUENCE_INDEX: 1,
        layout.RIG_TEXT: texts.rig_text,
        layout.PROTOCOL_TEXT: texts.protocol_text,
        layout.RIG_JSON: texts.rig_json,
        layout.VERSIONS: json.dumps({"python": platform.python_version(), **packages, **_of_others(texts)}),
    }


def _of_others(texts: Provenance) -> dict[str, Any]:
    """Return what is known of the devices' firmware, of calibrations, and digests of the texts."""
    digests = {
        name: text_digest(text)
        for name, text in (("rig", texts.rig_text), ("protocol", texts.protocol_text))
        if text is not None
    }
    known = {"firmware": texts.firmware, "sources": texts.sources, "sha256": digests}
    return {name: dict(values) for name, values in known.items() if values}
