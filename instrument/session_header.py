"""All that is known about a session before its first pose, as plain values: no device and no configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.stage import AxisDescription
from instrument.layout import Field
from instrument.records import Board, CameraRecord, Geometry


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
