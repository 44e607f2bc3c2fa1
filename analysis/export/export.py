"""Writes a result for renderers."""

from __future__ import annotations

from pathlib import Path

from analysis.export.comparison import compare
from analysis.export.map_folder import BITS, write_map_folder
from analysis.export.maps import prepare
from analysis.export.options import ExportOptions
from analysis.export.record import Record
from analysis.export.textures import as_read, textures
from analysis.results.result import Result
from instrument.files.whole_file import written_whole


def export(result: Result, output: Path | str, options: ExportOptions | None = None, source: str = "") -> Record:
    """Write a result as maps or as a scene, and measure how far pictures of it are from the result's own.

    Parameters
    ----------
    result : Result
    output : Path or str
        Folder or file to write; there must be nothing of that name.
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
        If no pixel is solved, or the part or the resolution is not within the area.
    FileExistsError
        If there is something at `output`.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    options, output = options or ExportOptions(), Path(output)
    prepared = prepare(result, options.crop, options.resolution, options.white_reflectance)
    written = textures(prepared.maps, BITS)
    record = Record(prepared, written, compare(prepared, as_read(prepared.maps, written)), source)
    with written_whole(output) as part:
        write_map_folder(part, output.name, record, options.normals or "both")
    return record
