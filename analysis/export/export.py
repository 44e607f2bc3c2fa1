"""Writes a result for renderers."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.export import map_folder
from analysis.export.comparison import compare
from analysis.export.maps import Prepared, SurfaceMaps, prepare
from analysis.export.options import TITLE, ExportOptions, Normals
from analysis.export.record import Record
from analysis.export.scenes import gltf
from analysis.export.scenes.materialx import write_materialx
from analysis.export.scenes.merl import write_merl_tables
from analysis.export.scenes.mesh import mesh_of
from analysis.export.scenes.mitsuba import write_mitsuba
from analysis.export.scenes.usd import write_usd
from analysis.export.textures import Textures, as_read, textures
from analysis.reflectance.palette import PALETTE
from analysis.results.result import Result
from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import written_whole

_BESIDE_MAPS: dict[str, Callable[[Path, str, Record], dict[str, str]]] = {
    "maps": lambda folder, stem, record: {},
    "materialx": write_materialx,
    "usd": write_usd,
    "mitsuba": write_mitsuba,
    "merl": write_merl_tables,
}
"""What a target adds to a folder of maps."""

_UNSAFE = re.compile(r"[^\w.-]")
"""What stands for something else in one of the formats, in a name."""

_NORMALS: dict[str, Normals] = {
    "maps": "both",
    "materialx": "opengl",
    "usd": "opengl",
    "mitsuba": "opengl",
    "merl": "both",
}


def export_result(result: Result, output: Path | str, options: ExportOptions | None = None, source: str = "") -> Record:
    """Write a result as maps or as a scene, and measure how far pictures of it are from the result's own.

    Parameters
    ----------
    result : Result
    output : Path or str
        Folder to write, of glTF a file; there must be nothing of that name.
    options : ExportOptions, optional
    source : str
        Name of the result's file, for the record.

    Returns
    -------
    Record
        With the errors by the difference angle, of the textures as they were written.

    Raises
    ------
    InvalidInputError
        If no pixel is solved, the part or the resolution is not within the area, or a name does not end as it should.
    FileExistsError
        If there is something at `output`.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    options, output = options or ExportOptions(), Path(output)
    _check(result, output, options)
    prepared = prepare(result, options.crop, options.resolution, options.white_reflectance)
    if options.target == "gltf":
        written = textures(prepared.maps, gltf.BITS)
        record = _record(prepared, written, _as_shaped(prepared.maps, written, options.mesh), source)
        with written_whole(output) as part:
            gltf.write_gltf(part, output.stem, record, mesh_of(prepared.maps, options.mesh))
        return record
    written = textures(prepared.maps, map_folder.BITS)
    record = _record(prepared, written, as_read(prepared.maps, written), source)
    stem = _UNSAFE.sub("_", output.name)
    with written_whole(output) as part:
        maps = map_folder.write_map_folder(part, stem, record, options.normals or _NORMALS[options.target])
        beside = _BESIDE_MAPS[options.target](part, stem, record)
        map_folder.write_record(part, stem, record, maps, beside)
    return record


def _check(result: Result, output: Path, options: ExportOptions) -> None:
    if options.mesh is not None and not np.isfinite(result.depth).any():
        raise InvalidInputError(TITLE, [Problem("--mesh", "needs heights, and the result has no depth: leave it away")])
    if options.target == "merl" and result.fits.dictionary.name != PALETTE:
        what = "has no palette, whose materials are written; reconstruct it with --palette on"
        raise InvalidInputError(TITLE, [Problem("result", what)])
    if options.target == "gltf" and output.suffix.lower() != gltf.SUFFIX:
        what = f"ends in {output.suffix!r}; glTF is written as one file that ends in {gltf.SUFFIX}"
        raise InvalidInputError(TITLE, [Problem(str(output), what)])


def _record(prepared: Prepared, written: Textures, read: SurfaceMaps, source: str) -> Record:
    return Record(prepared, written, compare(prepared, read), source)


def _as_shaped(maps: SurfaceMaps, written: Textures, mesh: int | None) -> SurfaceMaps:
    """Return the maps as a file of glTF has them, whose heights are those of its vertices."""
    height = np.zeros(maps.shape) if mesh is None else maps.displacement
    return replace(as_read(maps, written), displacement=height)
