"""A forward model of its own for the tests of the analysis: a bumpy sample, GGX materials, no shared code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.registration.stack import Stack, Truth

Array = NDArray[np.float64]


def camera_ring(n_views: int, distance: float = 350.0, widest_deg: float = 55.0) -> Array:
    """Return cameras on a spiral over a cap about the z axis, shape (n_views, 3), mm."""
    i = np.arange(n_views) + 0.5
    z = 1.0 - (1.0 - np.cos(np.deg2rad(widest_deg))) * i / n_views
    azimuth = np.pi * (1.0 + 5.0**0.5) * i
    s = np.sqrt(1.0 - z * z)
    return distance * np.stack([s * np.cos(azimuth), s * np.sin(azimuth), z], axis=-1)


def relief(x: Array, y: Array) -> tuple[Array, Array]:
    """Return height (mm) and unit normals of an egg-box surface."""
    a, kx, ky = 0.25, 2 * np.pi / 9.0, 2 * np.pi / 7.0
    z = a * np.sin(kx * x + 0.3) * np.cos(ky * y)
    p = a * kx * np.cos(kx * x + 0.3) * np.cos(ky * y)
    q = -a * ky * np.sin(kx * x + 0.3) * np.sin(ky * y)
    n = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    return z, n / np.linalg.norm(n, axis=-1, keepdims=True)


def ggx(n_dot_h: Array, n_dot_l: Array, n_dot_v: Array, alpha: Array) -> Array:
    """Return D G / (4 cos cos) of a GGX microfacet surface with Smith masking."""
    a2 = alpha**2
    D = a2 / (np.pi * (n_dot_h**2 * (a2 - 1.0) + 1.0) ** 2)

    def v(c: Array) -> Array:
        return 1.0 / (c + np.sqrt(a2 + (1.0 - a2) * c * c))

    return D * v(n_dot_l) * v(n_dot_v)


def brdf(normal: Array, light: Array, view: Array, material: NDArray[np.int64]) -> Array:
    """Return f of three materials (matte, satin, glossy), last axis 3 channels."""
    h = light + view
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    alpha = np.array([0.6, 0.3, 0.12])[material]
    strength = np.array([0.0, 0.04, 0.06])[material]
    albedo = np.array([[0.5, 0.3, 0.2], [0.1, 0.3, 0.4], [0.3, 0.25, 0.05]])[material]
    n_dot_h, n_dot_l, n_dot_v = (np.maximum(np.sum(normal * d, axis=-1), 1e-3) for d in (h, light, view))
    spec = strength * ggx(n_dot_h, n_dot_l, n_dot_v, alpha)
    return albedo / np.pi + spec[..., None]


def make_stack(
    n_views: int = 40,
    size: int = 32,
    pitch: float = 0.4,
    noise: float = 0.005,
    floor: float = 0.001,
    light_offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    registered_to: str = "surface",
    seed: int = 0,
) -> Stack:
    """Return a stack with its truth; `registered_to` is ``"surface"`` or ``"plane"`` (then with parallax).

    One sigma of a radiance is `noise` times itself plus `floor` times the median.
    """
    rng = np.random.default_rng(seed)
    camera = camera_ring(n_views)
    rotation = _looking_down(camera)
    light = camera + np.einsum("nij,i->nj", rotation, np.array(light_offset))
    x, y = np.meshgrid((np.arange(size) - (size - 1) / 2) * pitch, ((size - 1) / 2 - np.arange(size)) * pitch)
    z, n = relief(x, y)
    radiance = np.empty((n_views, size, size, 3))
    for v in range(n_views):
        xv, yv, zv = x, y, z
        if registered_to == "plane":
            xv, yv = _seen_through_plane(camera[v], x, y)
            zv = relief(xv, yv)[0]
        radiance[v] = _shade(np.stack([xv, yv, zv], axis=-1), relief(xv, yv)[1], camera[v], light[v])
    sigma = noise * radiance + floor * np.median(radiance)
    noisy = radiance + sigma * rng.standard_normal(radiance.shape)
    return Stack(
        radiance=noisy.astype(np.float32),
        variance=(sigma**2).astype(np.float32),
        camera_position=camera,
        light_position=light,
        light_power=np.ones(n_views),
        pixel_pitch=pitch,
        camera_rotation=rotation,
        truth=Truth(n, z - z.mean(), material_at(x, y)),
    )


def material_at(x: Array, y: Array) -> NDArray[np.int64]:
    """Return which material lies where: three stripes."""
    return np.clip(np.floor((x + 0.3 * y) / 4.0 + 1.5), 0, 2).astype(np.int64)


def _shade(points: Array, normal: Array, camera: Array, light: Array) -> Array:
    to_light, to_camera = light - points, camera - points
    d2 = np.sum(to_light**2, axis=-1, keepdims=True)
    omega_i = to_light / np.sqrt(d2)
    omega_o = to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
    cosine = np.maximum(np.sum(normal * omega_i, axis=-1, keepdims=True), 0.0)
    return brdf(normal, omega_i, omega_o, material_at(points[..., 0], points[..., 1])) * cosine / d2


def _seen_through_plane(camera: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Return the surface points that the camera sees through points (x, y) of the plane z = 0."""
    xs, ys = x, y
    for _ in range(30):
        t = relief(xs, ys)[0] / camera[2]
        xs, ys = x + (camera[0] - x) * t, y + (camera[1] - y) * t
    return xs, ys


def _looking_down(camera: Array) -> Array:
    forward = -camera / np.linalg.norm(camera, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 1.0, 0.3])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def with_views(stack: Stack, views: NDArray[np.int64]) -> Stack:
    """Return the stack of these views only, in this order."""
    of_views = (
        "radiance", "camera_position", "light_position", "light_power", "variance", "saturated",
        "camera_rotation", "light_power_sigma", "registration_sigma",
    )  # fmt: skip
    values = {name: getattr(stack, name) for name in of_views}
    return replace(stack, **{name: value[views] for name, value in values.items() if value is not None})
