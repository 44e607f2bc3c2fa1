"""Writes and reads results as HDF5 files (`*.result.h5`)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.palette.materials import group_materials
from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import tiles
from analysis.reconstruction.choices import Choice
from analysis.reflectance.atom_file import read_atoms, write_atoms
from analysis.reflectance.atoms import AnyAtom, TabulatedAtom
from analysis.reflectance.dictionary import Dictionary
from analysis.reflectance.palette_completion import MaterialBrdfs
from analysis.registration.grid import Grid
from analysis.results.result import DIFFUSE_REFERENCE_DEG, FLAG_NAMES, MODEL_NAMES, Result, diffuse_albedo, model_used
from analysis.results.result_checks import result_problems, value_problems
from analysis.results.summary import Summary, Value, plain, value_from_json
from analysis.results.views import read_views, write_views
from analysis.stages import Stage
from instrument.files.new_hdf5 import BOOKKEEPING_BYTES, new_hdf5
from instrument.files.probe import refuse_dangerous
from instrument.files.untrusted import HDF5_ERRORS, open_foreign, schema_problems, text_attribute
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.files.whole_file import refuse_unreadable, written_whole

SCHEMA = "1.2"
"""1.1 brought atoms that are tables, 1.2 the views as they were fitted."""


def write_result(path: Path, result: Result) -> None:
    """Write a new result file.

    Raises
    ------
    FileExistsError
        If there is a file already.
    InvalidInputError
        If the result could not be read again.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    values = {"choices": plain(result.choices), "stages": plain(result.stages), "summary": result.summary.as_dict()}
    texts = {name: json.dumps(value) for name, value in values.items()}
    n_bytes = _most_bytes(result) + sum(len(text) for text in texts.values())
    with written_whole(path) as part:
        with new_hdf5(part, n_bytes) as file:
            _write(file, result, texts)
        refuse_unreadable(path, part, read_result)


def _write(file: Any, result: Result, texts: dict[str, str]) -> None:
    file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": "halfangle"})
    entry = file.create_group("entry")
    entry.attrs.update({"NX_class": "NXentry", "default": "result", "halfangle_schema": SCHEMA})
    entry.create_dataset("program_version", data=version("halfangle"))
    for name, text in texts.items():
        entry.create_dataset(name, data=text)
    group = entry.create_group("result")
    group.attrs.update({"NX_class": "NXdata", "signal": "depth"})
    _write_maps(group, result)
    _write_brdf(entry.create_group("brdf"), result)
    if result.views is not None:
        write_views(entry.create_group("views"), result.views)


def _most_bytes(result: Result) -> int:
    """Return how large the file of a result becomes, at most: where nothing can be packed."""
    fits, n_channels = result.fits, result.fits.atom.shape[1]
    # float32: normals, sigmas, covariance, chi-square, angles, albedo, depth and its sigma, error.
    n_floats = 3 + 2 + 3 + 1 + 2 + n_channels + 2 + (result.truth_error is not None)
    # The groups and the models are of two bytes at most.
    of_pixel = 4 * n_floats + 2 + 2 + fits.flags.itemsize
    of_pixel += math.prod(fits.atom.shape[1:]) * (fits.atom.itemsize + 4)
    tables = [atom for atom in fits.dictionary.atoms if isinstance(atom, TabulatedAtom)]
    values = of_pixel * len(fits.normals) + 4 * sum(atom.value.size for atom in tables)
    values += 0 if result.materials is None else result.materials.log_sigma.nbytes
    n_views = 0 if result.views is None else len(result.views.light_power)
    # The edges of chunks go beyond the maps; a name or a view takes some bytes, and each dataset tables of HDF5.
    return int(1.1 * values) + 100 * (len(fits.dictionary.atoms) + n_views) + 3 * BOOKKEEPING_BYTES


def _write_maps(group: Any, result: Result) -> None:
    fits = result.fits
    albedo = f"pi f at {DIFFUSE_REFERENCE_DEG:g} deg or as far as seen"
    # Made one after the other, by tiles where it takes much more than the map: an area may have many megapixels.
    maps: list[tuple[str, Callable[[], NDArray[Any]], str, str]] = [
        ("normals", lambda: fits.normals, "", "unit vectors, sample frame"),
        ("normal_sigma_deg", lambda: np.rad2deg(fits.normal_sigma), "deg", "per tangent axis, one sigma"),
        ("normal_covariance", lambda: fits.covariance, "rad^2", "xx, xy, yy of the tangent parameters"),
        ("model", lambda: _by_tiles(model_used, fits), "", ""),
        ("flags", lambda: fits.flags, "", ""),
        ("reduced_chi2", lambda: fits.reduced_chi2, "", ""),
        ("theta_h_range", lambda: fits.theta_h_range, "rad", "smallest and largest half angle seen"),
        ("diffuse_albedo", lambda: _by_tiles(diffuse_albedo, fits), "", albedo),
        ("material", lambda: group_materials(fits), "", "groups of like curves, largest first; -1 = unsolved"),
    ]
    for name, values, units, meaning in maps:
        made = values()
        single = made.astype(np.float32) if made.dtype == np.float64 else made
        _write_map(group, name, result.as_map(single), units, meaning)
    _write_map(group, "depth", result.depth.astype(np.float32), "mm", "mean 0, out of the sample")
    _write_map(group, "depth_sigma", result.depth_sigma.astype(np.float32), "mm", "one sigma")
    if result.truth_error is not None:
        _write_map(group, "normal_error_deg", result.truth_error.astype(np.float32), "deg", "against the stack's truth")
    group["model"].attrs["names"] = np.array(MODEL_NAMES, dtype=h5py.string_dtype())
    group["flags"].attrs["bits"] = json.dumps({str(bit): text for bit, text in FLAG_NAMES.items()})
    group.create_dataset("pixel_pitch", data=result.grid.pitch).attrs["units"] = "mm"


def _by_tiles(make: Callable[[PixelFits], NDArray[Any]], fits: PixelFits) -> NDArray[Any]:
    return np.concatenate([make(fits.select(tile)) for tile in tiles(np.arange(len(fits.normals)))])


def _write_map(group: Any, name: str, values: Any, units: str, meaning: str) -> None:
    dataset = group.create_dataset(name, data=values, compression="lzf", shuffle=True)
    attributes = {"units": units, "long_name": meaning, "interpretation": "image" if values.ndim > 2 else ""}
    dataset.attrs.update({key: text for key, text in attributes.items() if text})


def _write_brdf(group: Any, result: Result) -> None:
    """Write f = sum_j coefficient_j atom_j, and the atoms with it."""
    fits = result.fits
    group.attrs.update({"NX_class": "NXcollection", "dictionary": fits.dictionary.name, "units": "1/sr"})
    group.attrs["meaning"] = "BRDF of channel c = sum over j of coefficient[..., c, j] times atom[..., c, j]; -1 = none"
    write_atoms(group, fits.dictionary.atoms)
    for name, values in (("atom", fits.atom), ("coefficient", fits.coefficient.astype(np.float32))):
        group.create_dataset(name, data=result.as_map(values), compression="lzf", shuffle=True)
    if result.materials is not None:
        _write_band(group.create_group("band"), result.materials)


def _write_band(group: Any, materials: MaterialBrdfs) -> None:
    group.attrs["meaning"] = "one sigma of log BRDF of material k, channel c: log_sigma[k, c] over theta_h, theta_d"
    group.create_dataset("log_sigma", data=materials.log_sigma, compression="lzf", shuffle=True)
    for name, values in (("theta_h", materials.theta_h), ("theta_d", materials.theta_d), ("seen", materials.seen)):
        group.create_dataset(name, data=values).attrs["units"] = "rad"


def _read_band(group: Any, atoms: tuple[AnyAtom, ...]) -> MaterialBrdfs:
    log_sigma = group["log_sigma"][...]
    tables = tuple(atom for atom in atoms if isinstance(atom, TabulatedAtom))[: int(np.prod(log_sigma.shape[:2]))]
    theta_h, theta_d, seen = (group[name][...] for name in ("theta_h", "theta_d", "seen"))
    if log_sigma.shape != (len(seen), len(tables) // max(len(seen), 1), len(theta_h), len(theta_d)):
        raise ValueError("brdf/band/log_sigma does not match the materials and its angles")
    return MaterialBrdfs(tables, log_sigma, theta_h, theta_d, seen)


def open_result(path: Path) -> Result:
    """Read a result file that anybody may have made: as `read_result`, once a child process has found it harmless.

    Raises
    ------
    InvalidInputError
        With everything that is wrong.
    """
    refuse_dangerous(path)
    return read_result(path)


def read_result(path: Path) -> Result:
    """Read a result file.

    Raises
    ------
    InvalidInputError
        With everything that is missing or wrong, by its path in the file.
    """
    title = f"{path} cannot be read as a result."
    try:
        with open_foreign(path, title) as file:
            raise_if_any(title, [*schema_problems(file, SCHEMA), *result_problems(file)])
            return _read(file)
    except HDF5_ERRORS as error:
        if isinstance(error, InvalidInputError):
            raise InvalidInputError(title, error.problems) from None
        raise InvalidInputError(title, [Problem(str(path), f"not a result file, or damaged ({error})")]) from None


def _read(file: Any) -> Result:
    maps, brdf = file["/entry/result"], file["/entry/brdf"]
    height, width = maps["depth"].shape
    n_pixels = height * width
    atoms = read_atoms(brdf)
    atom = brdf["atom"][...].reshape(n_pixels, *brdf["atom"].shape[2:])
    if atom.max(initial=-1) >= len(atoms):
        raise ValueError("brdf/atom points beyond brdf/atom_model")

    def flat(name: str) -> Any:
        return maps[name][...].astype(np.float64).reshape(n_pixels, *maps[name].shape[2:])

    fits = PixelFits(
        normals=flat("normals"),
        covariance=flat("normal_covariance"),
        reduced_chi2=flat("reduced_chi2"),
        loss=np.full(n_pixels, np.nan),
        atom=atom,
        coefficient=brdf["coefficient"][...].astype(np.float64).reshape(atom.shape),
        flags=maps["flags"][...].ravel(),
        theta_h_range=flat("theta_h_range"),
        dictionary=Dictionary(text_attribute(brdf, "dictionary") or "", atoms),
    )
    grid = Grid(height, width, float(maps["pixel_pitch"][()]))
    raise_if_any("", value_problems(fits, grid))
    error = maps["normal_error_deg"][...].astype(np.float64) if "normal_error_deg" in maps else None
    return Result(
        fits=fits,
        grid=grid,
        depth=maps["depth"][...].astype(np.float64),
        depth_sigma=maps["depth_sigma"][...].astype(np.float64),
        truth_error=error,
        materials=_read_band(brdf["band"], fits.dictionary.atoms) if "band" in brdf else None,
        views=read_views(file["/entry/views"]) if "views" in file["/entry"] else None,
        choices=_read_value(file, "choices", tuple[Choice, ...]),
        stages=_read_value(file, "stages", tuple[Stage, ...]),
        summary=_read_value(file, "summary", Summary),
    )


def _read_value(file: Any, name: str, kind: type[Value]) -> Value:
    return value_from_json(kind, file[f"/entry/{name}"].asstr()[()], f"/entry/{name}")
