"""The header of a new session, from a connected rig, a protocol and its plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.camera import CameraDescription
from instrument.config.protocol import ProtocolConfig
from instrument.config.rig import RigConfig
from instrument.recording.header import Provenance, SessionHeader
from instrument.rig.rig import Rig
from instrument.session import layout
from instrument.session.layout import Field
from instrument.session.records import CameraRecord, Geometry
from protocols.planning.plan import Plan


def session_header(
    rig: Rig, protocol: ProtocolConfig, plan: Plan, kept: Mapping[Field, Any], sources: Mapping[str, str]
) -> SessionHeader:
    """Return the header of a session.

    Parameters
    ----------
    rig : Rig
        Connected.
    protocol : ProtocolConfig
    plan : Plan
    kept : mapping of Field to array
        Darks and flats of an earlier session.
    sources : mapping of str to str
        Digest of each file that the session was calibrated with, by what it is.
    """
    sample = protocol.sample or "a sample"
    camera, light, stage = rig.camera.describe(), rig.light.describe(), rig.stage.describe()
    return SessionHeader(
        title=protocol.name,
        sample=protocol.sample,
        description=f"{protocol.name}: {sample} on {rig.config.name}",
        plan_json=plan.json,
        plan_sha256=plan.sha256,
        n_poses=plan.n_poses,
        exposure_times=plan.exposure_times,
        camera=_camera_record(camera),
        geometry=_geometry(rig.config),
        boards=tuple(board.record for board in rig.config.boards),
        provenance=Provenance(
            protocol.text,
            rig.config.text,
            rig.config.model_dump_json(),
            firmware={"camera": camera.firmware, "light": light.firmware, "stage": stage.firmware},
            sources=sources,
        ),
        light_type="LED",
        light_serial=light.serial_number,
        stage_serial=stage.serial_number,
        axes=stage.axes,
        targets=plan.targets,
        has_darks=plan.darks > 0,
        optional=kept,
        empty=_filled_later(rig, plan),
    )


def _filled_later(rig: Rig, plan: Plan) -> dict[Field, tuple[int, ...]]:
    camera = rig.camera.describe()
    fields: dict[Field, tuple[int, ...]] = {layout.REFERENCE: (plan.n_poses,)}
    if plan.darks:
        fields[layout.DARK_TEMPERATURE] = (len(plan.exposure_times),)
    if plan.flats:
        fields[layout.FLAT_IMAGES] = (plan.flats, camera.height, camera.width)
        fields[layout.FLAT_TIME] = (plan.flats,)
        fields[layout.FLAT_DISTANCE] = (plan.flats,)
    return fields


def _camera_record(camera: CameraDescription) -> CameraRecord:
    return CameraRecord(
        make=camera.make,
        model=camera.model,
        serial_number=camera.serial_number,
        height=camera.height,
        width=camera.width,
        n_channels=1,
        dtype="u2",
        bit_depth=camera.bit_depth,
        black_level=camera.black_level,
        saturation_value=camera.saturation_level,
        bayer_pattern=camera.bayer_pattern,
        conversion_gain=camera.conversion_gain,
        read_noise=camera.read_noise,
    )


def _geometry(rig: RigConfig) -> Geometry:
    sigma = rig.light.offset_sigma_mm
    return Geometry(
        area_mm=rig.geometry.area_mm,
        working_distance_mm=rig.geometry.working_distance_mm,
        focal_length_px=rig.camera.focal_length_px,
        light_offset_mm=rig.light.offset_mm,
        light_offset_sigma_mm=(sigma, sigma, sigma),
    )
