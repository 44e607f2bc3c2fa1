"""What a session file says before its first pose, dataset by dataset."""

from __future__ import annotations

import json
import platform
import uuid
from importlib.metadata import version
from typing import Any

import numpy as np

from instrument import layout
from instrument.layout import Field
from instrument.session_header import SessionHeader


def known_values(header: SessionHeader, now: str) -> dict[Field, Any]:
    """Return the content of every dataset that does not wait for a frame; `now` is ISO 8601."""
    return {**_entry_values(header, now), **_device_values(header), **_provenance(header, now)}


def _entry_values(header: SessionHeader, now: str) -> dict[Field, Any]:
    sample = header.protocol.sample or "a sample"
    return {
        layout.TITLE: header.protocol.name,
        layout.START_TIME: now,
        layout.END_TIME: "",
        layout.UUID: str(uuid.uuid4()),
        layout.DESCRIPTION: f"{header.protocol.name}: {sample} on {header.rig.name}",
        layout.STATUS: layout.Status.RECORDING,
        layout.SAMPLE_NAME: header.protocol.sample,
        layout.PLAN_JSON: header.plan_json,
        layout.PLAN_SHA256: header.plan_sha256,
        layout.ORDER: np.arange(header.n_poses),
        layout.COUNT_TIME: header.exposure_times,
    }


def _device_values(header: SessionHeader) -> dict[Field, Any]:
    camera, rig = header.camera, header.rig
    return {
        layout.MAKE: camera.make,
        layout.MODEL: camera.model,
        layout.SERIAL: camera.serial_number,
        layout.BIT_DEPTH: camera.bit_depth,
        layout.BLACK_LEVEL: camera.black_level,
        layout.SATURATION: camera.saturation_level,
        layout.CONVERSION_GAIN: camera.conversion_gain,
        layout.READ_NOISE: camera.read_noise,
        layout.BAYER_PATTERN: camera.bayer_pattern,
        layout.LIGHT_TYPE: "LED",
        layout.LIGHT_SERIAL: header.light.serial_number,
        layout.STAGE_SERIAL: header.stage.serial_number,
        layout.AREA: rig.geometry.area_mm,
        layout.WORKING_DISTANCE: rig.geometry.working_distance_mm,
        layout.FOCAL_LENGTH: rig.camera.focal_length_px,
        layout.LIGHT_OFFSET: rig.light.offset_mm,
        layout.LIGHT_OFFSET_SIGMA: (rig.light.offset_sigma_mm,) * 3,
        layout.BOARDS_JSON: json.dumps([board.model_dump(mode="json") for board in rig.boards]),
    }


def _provenance(header: SessionHeader, now: str) -> dict[Field, Any]:
    packages = {name: version(name) for name in ("numpy", "h5py", "hdf5plugin")}
    return {
        layout.PROGRAM: "halfangle",
        layout.PROGRAM_VERSION: version("halfangle"),
        layout.DATE: now,
        layout.SEQUENCE_INDEX: 1,
        layout.RIG_TEXT: header.rig.text,
        layout.PROTOCOL_TEXT: header.protocol.text,
        layout.RIG_JSON: header.rig.model_dump_json(),
        layout.VERSIONS: json.dumps({"python": platform.python_version(), **packages}),
    }
