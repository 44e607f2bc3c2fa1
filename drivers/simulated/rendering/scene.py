"""The sample: a white printed plate at z = 0 with an insert of known relief and materials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.rendering import materials
from drivers.simulated.rendering.boards import Ink, draw_boards
from drivers.simulated.rendering.heightfield import HeightField, grid_axis, sample_heights
from drivers.simulated.rendering.materials import Material
from drivers.simulated.rendering.relief import design_scale, insert_heights, sigmoid
from drivers.simulated.settings import BenchSettings

Array = NDArray[np.float64]

INSERT_MARGIN_MM = 2.0

_PLATE_MARGIN_MM = 2.0

_NODES_ACROSS = 640

# Logistic scale whose 10 to 90 % width is the soft border of 0.5 mm.
_BORDER_MM = 0.5 / 4.4

_INSERT_EDGE_MM = 0.2 / 4.4

_INSERT_CORNER_MM = 5.0

Coverage = Callable[[Array, Array], Array]


class Surface(NamedTuple):
    """Everything the kernels know of the sample.

    Attributes
    ----------
    field : HeightField
        Heights, mm.
    weights : ndarray of float32, shape (ny, nx, n_materials)
        Share of each material of the insert at the nodes of `field`; the plate has the rest.
    rows : ndarray, shape (n_materials, ROW_LENGTH)
        The materials.
    ink : Ink
        What is printed on the plate.
    plate_half : float
        Half the width of the square plate, mm; beyond it is the dark table.
    """

    field: HeightField
    weights: NDArray[np.float32]
    rows: Array
    ink: Ink
    plate_half: float


@dataclass(frozen=True, slots=True)
class Scene:
    """A sample, for the kernels and for people.

    Attributes
    ----------
    surface : Surface
        Arrays.
    material_names : tuple of str
        In the order of the table's rows; the plate comes last.
    """

    surface: Surface
    material_names: tuple[str, ...]


def _disc(x0: float, y0: float, radius: float) -> Coverage:
    return lambda x, y: sigmoid((radius - np.hypot(x - x0, y - y0)) / _BORDER_MM)


def _upper_right(x: Array, y: Array) -> Array:
    return sigmoid((x - 1.5 - 1.2 * np.sin(0.35 * y)) / _BORDER_MM) * sigmoid((y + 1.0) / _BORDER_MM)


def _lower_right(x: Array, y: Array) -> Array:
    return sigmoid((x - 3.0) / _BORDER_MM) * sigmoid((-4.0 - y + 1.5 * np.sin(0.4 * x)) / _BORDER_MM)


# What lies on what: the first covers the whole insert.
_PATCHWORK: tuple[tuple[Material, Coverage], ...] = (
    (materials.SATIN_PLASTIC, lambda x, y: np.ones(np.broadcast_shapes(x.shape, y.shape))),
    (materials.TEAL_PAINT, _upper_right),
    (materials.TERRACOTTA, _lower_right),
    (materials.GOLD, _disc(-14.0, 11.0, 9.0)),
    (materials.RED_FABRIC, _disc(-15.0, -14.0, 10.5)),
)

_LACQUERED: tuple[tuple[Material, Coverage], ...] = ((materials.LACQUER, _PATCHWORK[0][1]),)

COVERINGS = {"relief": _PATCHWORK, "plane": _PATCHWORK, "sphere_cap": _LACQUERED}


def _inside_insert(half_widths: tuple[float, float], x: Array, y: Array) -> Array:
    # Rounded corners leave white paper round the boards, which come up to the corners of the area.
    r = min(_INSERT_CORNER_MM, *half_widths)
    q_x, q_y = np.abs(x) - (half_widths[0] - r), np.abs(y) - (half_widths[1] - r)
    beyond = np.hypot(np.maximum(q_x, 0.0), np.maximum(q_y, 0.0)) + np.minimum(np.maximum(q_x, q_y), 0.0)
    return sigmoid((r - beyond) / _INSERT_EDGE_MM)


def _shares(covering: tuple[tuple[Material, Coverage], ...], scale: float, x: Array, y: Array) -> Array:
    shares = np.zeros((len(covering), y.size, x.size))
    for k, (_, coverage) in enumerate(covering):
        # Drawn to scale, soft borders included: a smaller area has narrower ones.
        opacity = coverage(x[None, :] / scale, y[:, None] / scale)
        shares *= 1.0 - opacity
        shares[k] += opacity
    return shares


def _plate_half(bench: BenchSettings, half_widths: tuple[float, float]) -> float:
    reach = [*half_widths]
    for board in bench.boards:
        (left, top), (width, height) = board.corner_mm, board.size_mm
        reach += [abs(left), abs(left + width), abs(top), abs(top - height)]
    return max(reach) + _PLATE_MARGIN_MM


def build_scene(bench: BenchSettings) -> Scene:
    """Return the sample of a bench."""
    name = bench.simulation.scene
    half_widths = (0.5 * bench.area_mm[0] + INSERT_MARGIN_MM, 0.5 * bench.area_mm[1] + INSERT_MARGIN_MM)
    covering = COVERINGS[name]
    scale = design_scale(half_widths)
    pitch = 2.0 * max(half_widths) / _NODES_ACROSS
    field = sample_heights(lambda x, y: insert_heights(name, half_widths, x, y), half_widths, pitch)
    # The very nodes of the height field.
    x, y = (grid_axis(half + 2.0, pitch) for half in half_widths)
    weights = _shares(covering, scale, x, y) * _inside_insert(half_widths, x[None, :], y[:, None])
    chosen = tuple(material for material, _ in covering)
    surface = Surface(
        field=field,
        weights=np.ascontiguousarray(np.moveaxis(weights, 0, -1), dtype=np.float32),
        rows=materials.table(chosen),
        ink=draw_boards(bench.boards, bench.working_distance_mm / bench.focal_length_px),
        plate_half=_plate_half(bench, half_widths),
    )
    return Scene(surface, (*(material.name for material in chosen), materials.WHITE_PAPER.name))
