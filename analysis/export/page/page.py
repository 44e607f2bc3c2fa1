"""Writes a result as one HTML page in which the light can be moved; it needs nothing beside it and no network."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from analysis.export.page.columns import Columns, columns_of
from analysis.export.page.planes import pack
from analysis.export.page.texels import Lists, albedo_angle_plane, height_plane, lists_of, normal_plane, sigma_plane
from analysis.pixels.fits import PixelFits
from analysis.registration.grid import Grid
from analysis.results.result import DIFFUSE_REFERENCE_DEG, Result, diffuse_albedo
from analysis.results.result_file import open_result
from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import write_whole

Array = NDArray[np.float64]

TITLE = "The page cannot be made."

DISTANCE = 5.0
"""Of camera and light from the middle at first, times the longer side."""

_LIGHT = np.array([0.35, 0.45, 0.82])  # direction at first; upper right, as people expect it

LARGE = 12_000_000
"""Bytes of a page above which the command says how to have a smaller one."""

_N_TRIED = 20_000  # pixels that the first exposure is found from


@dataclass(frozen=True, slots=True)
class PageFacts:
    """What is to be known of a page.

    Attributes
    ----------
    width, height : int
        Pixels that the page holds.
    step : int
        Every so manieth pixel of the result is one of them, along rows and along columns.
    n_palette, n_own, n_unsolved : int
        Pixels that are mixtures of the palette's materials alone, others that are solved, and holes.
    """

    width: int
    height: int
    step: int
    n_palette: int
    n_own: int
    n_unsolved: int


@dataclass(frozen=True)
class _Sample:
    """The pixels of a result that a page shows.

    Attributes
    ----------
    pixels : ndarray, shape (height * width,)
        Flat indices.
    """

    pixels: NDArray[np.int64]
    height: int
    width: int
    step: int


def write_relighting_page(path: Path, result: Result, resolution: int = 1024, title: str = "") -> PageFacts:
    """Write the page to a new file.

    The page evaluates what `Result.render` evaluates, of each pixel by itself. Where the area has more pixels than
    `resolution`, every second or third and so on is shown; none is averaged, so that each is as the result has it.

    Parameters
    ----------
    path : Path
    result : Result
    resolution : int
        Most pixels along the longer side.
    title : str

    Raises
    ------
    InvalidInputError
        If no pixel is solved, or there are neither one channel nor three.
    FileExistsError
        If there is a file already.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    _check(result)
    sample = _sampled(result.grid, resolution)
    facts, page = _page(result, sample, title)
    write_whole(path, page)
    return facts


def relight(result_file: Path, page: Path, resolution: int = 1024) -> str:
    """Write the page of a result's file, and return what is to be known of it, for a terminal.

    Raises
    ------
    InvalidInputError, FileExistsError, NotWrittenError
        As `write_relighting_page`, or if the file is no result.
    """
    facts = write_relighting_page(page, open_result(result_file), resolution, result_file.name)
    shown = f"{facts.width} x {facts.height} pixels"
    if facts.step > 1:
        shown += f", one of {facts.step} in each direction; --resolution shows more"
    if page.stat().st_size > LARGE:
        shown += "; a lower --resolution makes it smaller"
    return "\n".join([f"size        {page.stat().st_size / 1e6:.1f} MB, {shown}", *_lines(facts)])


def _lines(facts: PageFacts) -> list[str]:
    total = facts.width * facts.height
    return [
        f"palette     {facts.n_palette / total:.1%} of the pixels: tables of the palette's materials, as in the result",
        f"own atoms   {facts.n_own / total:.1%}: each by the atoms of its own; beyond the half angles seen a guess",
        f"not solved  {facts.n_unsolved / total:.1%}: holes",
    ]


def _check(result: Result) -> None:
    n_channels = result.fits.atom.shape[1]
    if n_channels not in (1, 3):
        raise InvalidInputError(TITLE, [Problem("result", f"has {n_channels} channels; a page shows one or three")])
    if not np.isfinite(result.fits.normals[:, 0]).any():
        raise InvalidInputError(TITLE, [Problem("result", "no pixel of it is solved; choose another result")])


def _sampled(grid: Grid, resolution: int) -> _Sample:
    step = -(-max(grid.width, grid.height) // resolution)
    first = (step - 1) // 2
    rows, columns = np.arange(min(first, grid.height - 1), grid.height, step), np.arange(first, grid.width, step)
    columns = columns if len(columns) else np.array([grid.width - 1])
    pixels = (rows[:, None] * grid.width + columns).ravel()
    return _Sample(pixels, len(rows), len(columns), step)


def _page(result: Result, sample: _Sample, title: str) -> tuple[PageFacts, str]:
    fits, grid = result.fits.select(sample.pixels), result.grid
    columns = columns_of(fits)
    lists = lists_of(fits, columns)
    facts = _facts(sample, columns.n_materials, lists, np.isfinite(fits.normals[:, 0]))
    maps, ranges = _maps(fits, result.depth.ravel()[sample.pixels], sample)
    index, data = pack(maps | _lists(columns, lists))
    meta = {
        "title": title,
        "width": sample.width,
        "height": sample.height,
        "n_materials": columns.n_materials,
        "material_colours": mpl.colormaps["tab20"](np.arange(columns.n_materials) % 20)[:, :3].tolist(),
        "albedo_deg": DIFFUSE_REFERENCE_DEG,
        "white_albedo": _white_albedo(fits),
        **ranges,
        **_scene(result, sample),
        "arrays": index,
    }
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("analysis.export.page", "data"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("page.html").render(
        title=title,
        meta=meta,
        data=data,
        facts=asdict(facts),
        total=facts.width * facts.height,
        size_mm=(grid.width * grid.pitch, grid.height * grid.pitch),
        pitch_mm=grid.pitch,
        program=f"halfangle {version('halfangle')}",
    )
    return facts, page


def _maps(fits: PixelFits, depth: Array, sample: _Sample) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return what is known of each pixel, and what the ends of its ranges stand for."""
    heights, low, high = height_plane(depth)
    sigma, most_sigma = sigma_plane(fits)
    solved = np.where(np.isfinite(fits.normals[:, 0]), 255, 0).astype(np.uint8)
    planes: dict[str, NDArray[Any]] = {
        "normals": normal_plane(fits.normals),
        "heights": heights,
        "facts": np.stack([solved, sigma, albedo_angle_plane(fits)], axis=-1),
    }
    maps = {name: plane.reshape(sample.height, sample.width, -1) for name, plane in planes.items()}
    return maps, {"heights_mm": [low, high], "most_sigma_deg": most_sigma}


def _lists(columns: Columns, lists: Lists) -> dict[str, NDArray[Any]]:
    """Return the entries of the pixels and the reflectances that they name."""
    return {
        "counts": lists.count[None, :, None],
        "columns": lists.column[None, :, None],
        "weights": _as_differences(lists.weight)[None],
        "header": columns.header[None],
        "parameters": columns.parameters[None],
        "scales": lists.scale[None, :, None],
        "nodes": columns.nodes[..., None],
        "tables": columns.tables.reshape(-1, *columns.tables.shape[2:]),
    }


def _scene(result: Result, sample: _Sample) -> dict[str, Any]:
    """Return where the pixels are, and camera, light and exposure as they are at first."""
    grid = result.grid
    extent = max(grid.width, grid.height) * grid.pitch
    light = DISTANCE * extent * _LIGHT / np.linalg.norm(_LIGHT)
    camera = np.array([0.0, 0.0, DISTANCE * extent])
    return {
        "spacing_mm": sample.step * grid.pitch,
        "first_mm": grid.points_of(sample.pixels[:1])[0, :2].tolist(),
        "extent_mm": extent,
        "camera": camera.tolist(),
        "light": light.tolist(),
        "white": _white(result, sample, camera, light),
    }


def _as_differences(weight: NDArray[np.float16]) -> NDArray[np.uint16]:
    """Return red's bits, and green's and blue's as differences to them, which are 0 for materials."""
    bits = weight.view(np.uint16)
    return np.stack([bits[:, 0], bits[:, 1] - bits[:, 0], bits[:, 2] - bits[:, 0]], axis=-1)


def _facts(sample: _Sample, n_materials: int, lists: Lists, solved: NDArray[np.bool_]) -> PageFacts:
    pixel = np.repeat(np.arange(len(solved)), lists.count)
    own = np.bincount(pixel[lists.column >= n_materials], minlength=len(solved)) > 0
    of_palette = solved & ~own & (n_materials > 0)
    return PageFacts(
        width=sample.width,
        height=sample.height,
        step=sample.step,
        n_palette=int(of_palette.sum()),
        n_own=int((solved & ~of_palette).sum()),
        n_unsolved=int((~solved).sum()),
    )


def _white(result: Result, sample: _Sample, camera: Array, light: Array) -> float:
    """Return what is white at first: the 99th percentile of the render times the light's squared distance."""
    some = sample.pixels[:: max(len(sample.pixels) // _N_TRIED, 1)]
    points = result.grid.points_of(some, np.nan_to_num(result.depth))
    radiance = result.fits.select(some).radiance(points, camera, light)
    level = float(np.nanpercentile(radiance, 99.0)) if np.isfinite(radiance).any() else 0.0
    return (level or 1.0) * float(light @ light)


def _white_albedo(fits: PixelFits) -> float:
    """Return the albedo that is white at first: its 99th percentile, since the unit may be any."""
    some = fits.select(np.arange(0, len(fits.normals), max(len(fits.normals) // _N_TRIED, 1)))
    albedo = diffuse_albedo(some)
    level = float(np.nanpercentile(albedo, 99.0)) if np.isfinite(albedo).any() else 0.0
    return level or 1.0
