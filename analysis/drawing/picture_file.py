"""Pictures to and from files: EXR and NumPy for linear values, PNG for display."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from analysis.drawing.colours import display_colours
from analysis.drawing.figures import picture
from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import write_whole, written_whole

SUFFIXES = (".exr", ".npy", ".png")


def check_picture_name(path: Path) -> None:
    """Raise unless `path` ends in a format that can be written.

    Raises
    ------
    InvalidInputError
    """
    if path.suffix.lower() not in SUFFIXES:
        problem = Problem(str(path), f"ends in {path.suffix!r}; pictures are written as {', '.join(SUFFIXES)}")
        raise InvalidInputError("The picture cannot be written.", [problem])


def write_picture(path: Path, radiance: NDArray[np.float64]) -> None:
    """Write linear radiance (height, width, 1 or 3); NaN stays NaN in .exr and .npy.

    Raises
    ------
    FileExistsError
        If there is something at `path`.
    InvalidInputError
        If the name's ending is not one of `SUFFIXES`.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    check_picture_name(path)
    linear = radiance.astype(np.float32)
    if path.suffix.lower() == ".npy":
        file = io.BytesIO()
        np.save(file, linear)
        write_whole(path, file.getvalue())
    elif path.suffix.lower() == ".png":
        write_whole(path, picture(display_colours(radiance)))
    else:
        with written_whole(path) as part:
            write_exr(part, {"RGB": linear} if linear.shape[-1] == 3 else {"Y": linear[..., 0]})


def write_exr(path: Path, channels: Mapping[str, NDArray[Any]]) -> None:
    """Write channels in 32-bit floats at the temporary name of a file, or into a folder that is written whole.

    Parameters
    ----------
    path : Path
    channels : mapping of str to ndarray, shape (H, W), or (H, W, 3) under the name "RGB"
    """
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    floats = {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}
    OpenEXR.File(header, floats).write(str(path))
