"""Files in the format of the RGL database, written from a BRDF, since the measured ones may not be carried here."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Fields: TypeAlias = dict[str, NDArray[Any]]

Brdf: TypeAlias = Callable[[Array, Array], Array]
"""From omega_i and omega_o, shape (..., 3), to 1/sr, shape (..., 3)."""

TYPES = {"uint8": 1, "float32": 10, "float64": 11}

THETA_I = np.deg2rad([0.0, 15.0, 30.0, 45.0, 55.0, 65.0, 75.0, 82.0])


def lambert(omega_i: Array, omega_o: Array) -> Array:
    return np.broadcast_to(np.array([0.1, 0.2, 0.3]), np.broadcast_shapes(omega_i.shape, omega_o.shape))


def node_directions(theta_i: float, n: int) -> tuple[Array, Array]:
    """Return omega_i, shape (3,), and omega_o, shape (n, n, 3), at the nodes of a square that is warped by nothing."""
    unit = np.linspace(0.0, 1.0, n)
    theta_m, phi = np.meshgrid(unit**2 * np.pi / 2, (2 * unit - 1) * np.pi)
    omega_m = np.stack([np.sin(theta_m) * np.cos(phi), np.sin(theta_m) * np.sin(phi), np.cos(theta_m)], axis=-1)
    omega_i = np.array([np.sin(theta_i), 0.0, np.cos(theta_i)])
    return omega_i, 2 * (omega_m @ omega_i)[..., None] * omega_m - omega_i


def rgl_fields(brdf: Brdf = lambert, n: int = 33, theta_i: Array = THETA_I) -> Fields:
    """Return the fields of a file whose density is uniform, so that the square is warped by nothing."""
    unit, table = np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, 4 * n - 3)
    ndf = 0.05 + np.exp(-((2.0 * table) ** 2)) / np.pi
    sigma = 1.0 - 0.7 * table**2
    rgb = np.zeros((1, len(theta_i), 3, n, n))
    for row, theta in enumerate(theta_i):
        omega_i, omega_o = node_directions(theta, n)
        scale = 4.0 * np.interp(np.sqrt(theta / (np.pi / 2)), table, sigma) / np.interp(unit, table, ndf)
        value = brdf(omega_i, omega_o) * (omega_o[..., 2] * scale)[..., None]
        rgb[0, row] = np.moveaxis(np.where(omega_o[..., 2:] > 1e-9, value, 0.0), -1, 0)
    fields: Fields = {
        "version": np.array([1, 0], np.uint8),
        "description": np.frombuffer(b"Made of a formula", np.uint8),
        "phi_i": np.zeros(1),
        "theta_i": theta_i,
        "sigma": np.tile(sigma, (2, 1)),
        "ndf": np.tile(ndf, (2, 1)),
        "vndf": np.ones((1, len(theta_i), 5, 6)),
        "luminance": rgb.mean(axis=2),
        "rgb": rgb,
        "jacobian": np.ones(1, np.uint8),
        "valid": np.zeros(8, np.uint8),
    }
    return {name: field if field.dtype == np.uint8 else field.astype(np.float32) for name, field in fields.items()}


def header_size(fields: Fields) -> int:
    return 18 + sum(13 + len(name) + 8 * field.ndim for name, field in fields.items())


def rgl_bytes(fields: Fields) -> bytes:
    """Return the content of a file, as the database's are."""
    header, values = [b"tensor_file\0", struct.pack("<2BI", 1, 0, len(fields))], []
    offset = header_size(fields)
    for name, field in fields.items():
        header.append(struct.pack("<H", len(name)) + name.encode())
        header.append(struct.pack("<HBQ", field.ndim, TYPES[field.dtype.name], offset))
        header.append(struct.pack(f"<{field.ndim}Q", *field.shape))
        values.append(field.tobytes())
        offset += field.nbytes
    return b"".join(header + values)


def write_rgl(path: Path, fields: Fields) -> Path:
    path.write_bytes(rgl_bytes(fields))
    return path
