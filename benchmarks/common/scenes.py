"""Scenes to measure against: what a rig would have registered, with the truth kept.

The forward model is written out here and shares nothing with the solvers but the published material tables:
full BRDFs of (omega_i, omega_o), near field, the light where it stands. A dictionary must be of another origin
than the scene's materials: the parametric one against both tables, SGD against ABC.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.dictionary import published
from analysis.reflectance.models import Cosines, abc, sgd
from analysis.registration.stack import Stack, Truth

Array = NDArray[np.float64]

DISTANCE_MM, AREA_MM, FAR_MM = 350.0, 100.0, 1e4

DARK_FLOOR = 0.003
"""Noise that every sample has, as a share of the median radiance."""

# At 60 deg this row of the SGD table is ten times what it is at 59 deg: a defect of the fit.
_DEFECTIVE = {"sgd": ("white-paint",), "abc": ()}


@dataclass(frozen=True)
class Scene:
    """A stack and what is true of it.

    Attributes
    ----------
    name : str
    stack : Stack
        With `truth`.
    table : str
        ``"sgd"`` or ``"abc"``: where the materials come from.
    material : ndarray of int, shape (K,)
        Rows of the table.
    weight : ndarray, shape (P, K)
        Share of each material in each of the P = H * W pixels.
    """

    name: str
    stack: Stack
    table: str
    material: NDArray[np.int64]
    weight: Array

    @property
    def normals(self) -> Array:
        """True normals, shape (P, 3)."""
        assert self.stack.truth is not None
        return self.stack.truth.normals.reshape(-1, 3)

    def curve(self, theta_h: Array) -> Array:
        """Return the true curves on the slice, shape (P, T, C), at half angles `theta_h` of shape (P, T), rad."""
        return _mixture(self.table, self.material, self.weight, Cosines.on_slice(theta_h))

    def material_curves(self, theta_h: Array) -> Array:
        """Return the curves of the K materials, shape (K, T, C), at half angles `theta_h` of shape (T,), rad."""
        n = len(self.material)
        angles = np.broadcast_to(theta_h, (n, len(theta_h)))
        return _mixture(self.table, self.material, np.eye(n), Cosines.on_slice(angles))

    @property
    def names(self) -> list[str]:
        """Names of the materials, in the order of `material`."""
        return [str(name) for name in published(self.table)["name"][self.material]]

    def first(self, n_pixels: int) -> Scene:
        """Return the scene of the first `n_pixels` of independent pixels."""
        stack, truth = self.stack, self.stack.truth
        assert stack.pixels == "independent"
        assert truth is not None
        part = slice(n_pixels)
        cut = replace(
            stack,
            radiance=stack.radiance[:, :, part],
            variance=None if stack.variance is None else stack.variance[:, :, part],
            saturated=None if stack.saturated is None else stack.saturated[:, :, part],
            truth=Truth(truth.normals[:, part], truth.depth[:, part]),
        )
        return replace(self, stack=cut, weight=self.weight[part])


def material_rows(table: str) -> NDArray[np.int64]:
    """Return the rows of a published table that are fit to be scenes."""
    names = published(table)["name"]
    return np.flatnonzero(~np.isin(names, _DEFECTIVE[table]))


def cap(n_views: int, rng: np.random.Generator, widest_deg: float = 60.0) -> Array:
    """Return camera directions spread evenly over a cap, turned by a random angle, shape (n_views, 3)."""
    i = np.arange(n_views) + 0.5
    z = 1.0 - (1.0 - np.cos(np.deg2rad(widest_deg))) * i / n_views
    azimuth = np.pi * (1.0 + 5.0**0.5) * i + rng.uniform(0.0, 2.0 * np.pi)
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(azimuth), s * np.sin(azimuth), z], axis=-1)


def rings(n_views: int, rng: np.random.Generator, widest_deg: float = 60.0) -> Array:
    """Return camera directions on four tilts of a turntable, shape (n_views, 3)."""
    tilt = np.deg2rad(widest_deg) * (np.arange(n_views) % 4 + 0.25) / 3.25
    azimuth = 2.0 * np.pi * np.arange(n_views) / n_views + rng.uniform(0.0, 2.0 * np.pi)
    return np.stack([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)], axis=-1)


def scattered(n_views: int, rng: np.random.Generator, widest_deg: float = 60.0, narrowest_deg: float = 0.0) -> Array:
    """Return camera directions drawn at random over a cap, as of a camera held by hand, shape (n_views, 3)."""
    highest, lowest = np.cos(np.deg2rad([narrowest_deg, widest_deg]))
    z = highest - (highest - lowest) * rng.random(n_views)
    azimuth = 2.0 * np.pi * rng.random(n_views)
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(azimuth), s * np.sin(azimuth), z], axis=-1)


POSES = {"cap": cap, "rings": rings, "scattered": scattered}


def independent(
    n_pixels: int,
    n_views: int,
    noise: float,
    seed: int,
    *,
    table: str = "sgd",
    poses: str = "cap",
    materials: NDArray[np.int64] | None = None,
    widest_normal_deg: float = 35.0,
    narrowest_normal_deg: float = 0.0,
    theta_d_deg: float = 0.0,
    floor: float = DARK_FLOOR,
    mixed: bool = False,
    blur_deg: float = 0.0,
) -> Scene:
    """Return unrelated pixels, each of its own material and normal, seen from afar by a collocated rig.

    Parameters
    ----------
    n_pixels, n_views : int
    noise : float
        One sigma of a radiance, relative; `floor` comes on top.
    seed : int
    table : {"sgd", "abc"}
    poses : str
        A key of `POSES`.
    materials : ndarray of int or None
        Rows of the table to draw from; None = all.
    widest_normal_deg, narrowest_normal_deg : float
        Normals are drawn evenly over a cap of this half width, without the cap of the second.
    theta_d_deg : float
        Half the angle between light and camera; the light stands to one side of every camera.
    floor : float
        Noise that every sample has, as a share of the median radiance.
    mixed : bool
        Each pixel is of two materials, in shares of 0 to 1.
    blur_deg : float
        Each pixel is the mean over normals on a ring of this radius about its own.
    """
    rng = np.random.default_rng(seed)
    rows = material_rows(table) if materials is None else materials
    which = rng.integers(0, len(rows), n_pixels)
    normals = scattered(n_pixels, rng, widest_normal_deg, narrowest_normal_deg)
    camera = POSES[poses](n_views, rng)
    light = _beside(camera, 2.0 * np.deg2rad(theta_d_deg))
    weight = np.eye(len(rows))[which]
    if mixed:
        share = rng.random((n_pixels, 1))
        weight = share * weight + (1.0 - share) * np.eye(len(rows))[rng.integers(0, len(rows), n_pixels)]
    radiance = np.mean(
        [_shade_from_afar(n, camera, light, table, rows, weight) for n in _ring(normals, blur_deg)], axis=0
    )[:, None]
    # So far away that every pixel has the same directions.
    radiance, variance = with_noise(radiance / FAR_MM**2, noise, rng, floor)
    depth = np.full((1, n_pixels), np.nan)
    stack = Stack(
        radiance=radiance,
        variance=variance,
        camera_position=FAR_MM * camera,
        light_position=FAR_MM * light,
        light_power=np.ones(n_views),
        pixel_pitch=1e-6 * FAR_MM / n_pixels,
        pixels="independent",
        truth=Truth(normals[None], depth, which[None]),
    )
    return Scene("independent", stack, table, rows, weight)


def relief(
    size: int,
    n_views: int,
    noise: float,
    seed: int,
    *,
    table: str = "sgd",
    poses: str | Array = "cap",
    n_materials: int = 5,
    materials: NDArray[np.int64] | None = None,
    offset_mm: float = 12.0,
    wrong: float = 0.0,
    power_error: float = 0.0,
    steepness: float = 1.0,
    floor: float = DARK_FLOOR,
) -> Scene:
    """Return a relief of some millimetres, `AREA_MM` wide, of materials with soft borders, near field.

    Parameters
    ----------
    size : int
        Pixels a side.
    n_views, noise, seed, table
        As `independent`.
    poses : str or ndarray, shape (n_views, 3)
        A key of `POSES`, or the directions of the cameras.
    n_materials : int
        0 = one material that changes from place to place without end (no palette).
    materials : ndarray of int or None
        Rows of the table that it is made of; None = drawn at random.
    offset_mm : float
        Of the light from the lens.
    wrong : float
        Share of samples that are wrong: half dimmed to a tenth (a shadow), half lit twice to five times.
    power_error : float
        One sigma of each view's light power that the stack does not know of, relative.
    steepness : float
        Factor of the heights; 0 = a plane.
    floor : float
        As `independent`.
    """
    rng = np.random.default_rng(seed)
    pitch = AREA_MM / size
    axis = (np.arange(size) - (size - 1) / 2) * pitch
    x, y = np.meshgrid(axis, -axis)
    z, normals = _surface(x, y, rng, steepness)
    drawn = rng.choice(material_rows(table), max(n_materials, 8 * (n_materials == 0)), replace=False)
    rows = drawn if materials is None else materials
    weight = _regions(x, y, len(rows), rng, soft_mm=1.0 if n_materials else 25.0)
    camera = DISTANCE_MM * (POSES[poses](n_views, rng) if isinstance(poses, str) else poses)
    rotation = _level(camera)
    light = camera + offset_mm * rotation[:, 0]
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    radiance = np.empty((n_views, size, size, 3), np.float32)
    for v in range(n_views):
        shade = _shade(points, normals.reshape(-1, 3), camera[v], light[v], table, rows, weight)
        radiance[v] = shade.reshape(size, size, 3) * (1.0 + power_error * rng.standard_normal())
    radiance, variance = with_noise(radiance, noise, rng, floor)
    if wrong > 0.0:
        bad = rng.random(radiance.shape[:3]) < wrong
        factor = np.where(rng.random(bad.shape) < 0.5, 0.1, rng.uniform(2.0, 5.0, bad.shape))
        radiance = np.where(bad[..., None], radiance * factor[..., None], radiance).astype(np.float32)
    stack = Stack(
        radiance=radiance,
        variance=variance,
        camera_position=camera,
        light_position=light,
        light_power=np.ones(n_views),
        pixel_pitch=pitch,
        camera_rotation=rotation,
        truth=Truth(normals, z - z.mean(), weight.argmax(axis=1).reshape(size, size)),
    )
    return Scene("relief", stack, table, rows, weight)


def relief_of(
    brdfs: Sequence[Callable[[Array, Array], Array]], size: int, poses: Array, noise: float, rng: np.random.Generator
) -> Stack:
    """Return the stack of a relief as `relief`, of materials that any functions tell.

    Parameters
    ----------
    brdfs : sequence of callable
        From omega_i and omega_o of shape (P, 3), the normal being z, to 1/sr, shape (P, 3).
    size : int
        Pixels a side.
    poses : ndarray, shape (n_views, 3)
        Directions of the cameras; the light is 12 mm beside them.
    noise : float
        As `independent`.
    rng : numpy.random.Generator
    """
    pitch = AREA_MM / size
    axis = (np.arange(size) - (size - 1) / 2) * pitch
    x, y = np.meshgrid(axis, -axis)
    z, normals = _surface(x, y, rng, 1.0)
    weight = _regions(x, y, len(brdfs), rng, soft_mm=1.0)
    camera = DISTANCE_MM * poses
    rotation = _level(camera)
    light = camera + 12.0 * rotation[:, 0]
    points, n = np.stack([x, y, z], axis=-1).reshape(-1, 3), normals.reshape(-1, 3)
    side = np.cross(n, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    frame = np.stack([side, np.cross(n, side), n], axis=1)
    radiance = np.empty((len(poses), size, size, 3))
    for v in range(len(poses)):
        to_light, to_camera = light[v] - points, camera[v] - points
        d2 = np.sum(to_light**2, axis=1, keepdims=True)
        omega_i, omega_o = (
            np.einsum("pij,pj->pi", frame, d / np.linalg.norm(d, axis=1, keepdims=True)) for d in (to_light, to_camera)
        )
        f = sum(weight[:, [k]] * np.maximum(brdf(omega_i, omega_o), 0.0) for k, brdf in enumerate(brdfs))
        radiance[v] = (f * np.maximum(omega_i[:, 2:], 0.0) / d2).reshape(size, size, 3)
    noisy, variance = with_noise(radiance, noise, rng)
    return Stack(
        radiance=noisy,
        variance=variance,
        camera_position=camera,
        light_position=light,
        light_power=np.ones(len(poses)),
        pixel_pitch=pitch,
        camera_rotation=rotation,
        truth=Truth(normals, z - z.mean(), weight.argmax(axis=1).reshape(size, size)),
    )


def _mixture(table: str, rows: NDArray[np.int64], weight: Array, q: Cosines) -> Array:
    """BRDF of each pixel, shape (P, T, C), for cosines of shape (P, T)."""
    f = np.zeros((*q.n_dot_h.shape, 3))
    model = {"sgd": sgd, "abc": abc}[table]
    for k, row in enumerate(rows):
        users = np.flatnonzero(weight[:, k] > 1e-6)
        if len(users):
            part = Cosines(q.n_dot_h[users], q.cos_d[users], q.n_dot_l[users], q.n_dot_v[users])
            f[users] += weight[users, k, None, None] * model(part, published(table)[row])
    return f


def _shade(
    points: Array, normals: Array, camera: Array, light: Array, table: str, rows: NDArray[np.int64], weight: Array
) -> Array:
    """Radiance of every point in one view, shape (P, 3)."""
    to_light, to_camera = light - points, camera - points
    d2 = np.sum(to_light**2, axis=-1, keepdims=True)
    omega_i = to_light / np.sqrt(d2)
    omega_o = to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
    q = Cosines.from_directions(normals, omega_i, omega_o)
    columns = Cosines(*(c[:, None] for c in (q.n_dot_h, q.cos_d, q.n_dot_l, q.n_dot_v)))
    n_dot_l = np.sum(normals * omega_i, axis=-1, keepdims=True)
    n_dot_v = np.sum(normals * omega_o, axis=-1, keepdims=True)
    lit = np.where(n_dot_v > 0.0, np.maximum(n_dot_l, 0.0), 0.0)
    return np.asarray(np.maximum(_mixture(table, rows, weight, columns)[:, 0], 0.0) * lit / d2)


def _beside(direction: Array, angle: float) -> Array:
    """Turn unit vectors by `angle` (rad) to one side, shape as `direction`."""
    side = np.cross(direction, [0.0, 1.0, 0.3])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return np.asarray(np.cos(angle) * direction + np.sin(angle) * side)


def _ring(normals: Array, radius_deg: float) -> list[Array]:
    """Return the normals, or six sets of them on a ring about each."""
    if radius_deg == 0.0:
        return [normals]
    side = _beside(normals, np.pi / 2)
    up = np.cross(normals, side)
    r = np.deg2rad(radius_deg)
    return [np.cos(r) * normals + np.sin(r) * (np.cos(a) * side + np.sin(a) * up) for a in np.arange(6) * np.pi / 3]


def _shade_from_afar(
    normals: Array, camera: Array, light: Array, table: str, rows: NDArray[np.int64], weight: Array
) -> Array:
    """Radiance of P pixels at distance 1 from the light in all N views, shape (N, P, 3)."""
    shape = (len(normals), *camera.shape)
    q = Cosines.from_directions(normals[:, None], np.broadcast_to(light, shape), np.broadcast_to(camera, shape))
    n_dot_l = np.where(normals @ camera.T > 0.0, np.maximum(normals @ light.T, 0.0), 0.0)
    return np.moveaxis(np.maximum(_mixture(table, rows, weight, q), 0.0) * n_dot_l[..., None], 1, 0)


def with_noise(
    radiance: NDArray[np.floating[Any]], noise: float, rng: np.random.Generator, floor: float = DARK_FLOOR
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Add noise; return the radiance and its stated variance, which is the true one."""
    sigma = np.sqrt((noise * radiance) ** 2 + (floor * np.median(radiance)) ** 2)
    noisy = radiance + sigma * rng.standard_normal(radiance.shape)
    return noisy.astype(np.float32), (sigma**2).astype(np.float32)


def _surface(x: Array, y: Array, rng: np.random.Generator, steepness: float) -> tuple[Array, Array]:
    """Height (mm) and normals of a sum of waves, 12 to 60 mm long, slopes to about 20 deg."""
    z, p, q = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    for _ in range(14):
        length, angle, phase = rng.uniform(12.0, 60.0), rng.uniform(0.0, np.pi), rng.uniform(0.0, 2.0 * np.pi)
        kx, ky = 2.0 * np.pi / length * np.array([np.cos(angle), np.sin(angle)])
        height = 0.006 * length * steepness
        z += height * np.sin(kx * x + ky * y + phase)
        p += height * kx * np.cos(kx * x + ky * y + phase)
        q += height * ky * np.cos(kx * x + ky * y + phase)
    n = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    return z, n / np.linalg.norm(n, axis=-1, keepdims=True)


def _regions(x: Array, y: Array, n: int, rng: np.random.Generator, soft_mm: float) -> Array:
    """Shares of `n` materials around scattered seeds with borders `soft_mm` wide, shape (P, n)."""
    centre = rng.uniform(-0.5 * AREA_MM, 0.5 * AREA_MM, (4 * n, 2))
    distance = np.hypot(x.reshape(-1, 1) - centre[:, 0], y.reshape(-1, 1) - centre[:, 1])
    score = np.exp(-(distance - distance.min(axis=1, keepdims=True)) / soft_mm)
    weight = np.stack([score[:, k::n].sum(axis=1) for k in range(n)], axis=1)
    weight = np.where(weight > 0.02, weight, 0.0)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _level(camera: Array) -> Array:
    """Rotations sample to camera of cameras that look at the origin, shape (N, 3, 3)."""
    forward = -camera / np.linalg.norm(camera, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 1.0, 0.3])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], axis=1)
