"""Depth from normals: the least-squares surface whose slopes are the measured ones.

With slopes p = -n_x / n_z = dz/dx and q = -n_y / n_z = dz/dy, z minimises over all pairs of neighbours

    sum (z_b - z_a - pitch (s_a + s_b) / 2)^2 ,

s being the slope along the pair. On a full rectangle the normal equations are a Poisson equation with
Neumann borders, which the cosine transform makes diagonal [frankot1988, simchony1990]; with holes they
are solved by conjugate gradients that the same transform preconditions. Depth has mean 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn
from scipy.sparse.linalg import LinearOperator, cg

Array = NDArray[np.float64]

MAX_SLOPE = 5.0
"""Steeper than 79 deg a normal says nothing about depth: the pixel counts as a hole."""


def integrate_normals(normals: Array, pitch: float, tolerance: float = 1e-6) -> Array:
    """Integrate a normal map.

    Parameters
    ----------
    normals : ndarray, shape (height, width, 3)
        Unit vectors, x right, y up, z out of the sample; NaN = hole.
    pitch : float
        Size of a pixel, mm.
    tolerance : float
        Relative residual at which conjugate gradients stop; unused without holes.

    Returns
    -------
    ndarray, shape (height, width)
        Depth in mm, mean 0 over the pixels that have a normal, NaN in holes. Parts that holes cut off
        from each other have an arbitrary height against each other.
    """
    p, q, valid = slopes_from_normals(normals)
    depth = integrate_slopes(p, q, valid, pitch, tolerance)
    return np.where(valid, depth, np.nan)


def slopes_from_normals(normals: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return dz/dx, dz/dy (0 in holes) and where they are known."""
    n_z = normals[..., 2]
    steepest = np.maximum(np.abs(normals[..., 0]), np.abs(normals[..., 1]))
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(normals).all(axis=-1) & (n_z > 0.0) & (steepest <= MAX_SLOPE * n_z)
    safe = np.where(valid, n_z, 1.0)
    p = np.where(valid, -normals[..., 0] / safe, 0.0)
    q = np.where(valid, -normals[..., 1] / safe, 0.0)
    return p, q, valid


def integrate_slopes(p: Array, q: Array, valid: NDArray[np.bool_], pitch: float, tolerance: float = 1e-6) -> Array:
    """Integrate slopes dz/dx (`p`) and dz/dy (`q`), each of shape (height, width); mean 0 over `valid`."""
    if not valid.any():
        return np.full(p.shape, np.nan)
    # A pair of neighbours counts if both ends are known. y grows upwards, rows downwards.
    w_x = (valid[:, :-1] & valid[:, 1:]).astype(np.float64)
    w_y = (valid[:-1] & valid[1:]).astype(np.float64)
    g_x = 0.5 * pitch * (p[:, :-1] + p[:, 1:])
    g_y = -0.5 * pitch * (q[:-1] + q[1:])
    right_side = _transposed_differences(w_x * g_x, w_y * g_y)
    eigenvalues = _laplacian_eigenvalues(p.shape)
    if valid.all():
        z = _solve_poisson(right_side, eigenvalues)
    else:
        z = _solve_with_holes(right_side, w_x, w_y, eigenvalues, tolerance)
    return np.asarray(z - z[valid].mean())


def _transposed_differences(along_x: Array, along_y: Array) -> Array:
    """D^T applied to values on horizontal and vertical pairs."""
    z = np.zeros((along_x.shape[0], along_y.shape[1]))
    z[:, 1:] += along_x
    z[:, :-1] -= along_x
    z[1:] += along_y
    z[:-1] -= along_y
    return z


def _laplacian_eigenvalues(shape: tuple[int, ...]) -> Array:
    rows, columns = (2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in shape)
    eigenvalues = rows[:, None] + columns[None, :]
    eigenvalues[0, 0] = 1.0  # the mean, which the slopes leave free and the caller sets
    return np.asarray(eigenvalues)


def _solve_poisson(right_side: Array, eigenvalues: Array) -> Array:
    spectrum = dctn(right_side, norm="ortho") / eigenvalues
    spectrum[0, 0] = 0.0
    return np.asarray(idctn(spectrum, norm="ortho"))


def _solve_with_holes(right_side: Array, w_x: Array, w_y: Array, eigenvalues: Array, tolerance: float) -> Array:
    shape = right_side.shape
    # Pixels without a neighbour would make the matrix singular beyond the mean; a whisper of the identity
    # holds them at zero and moves the others by less than the tolerance.
    whisper = 1e-9

    def matrix(z: Array) -> Array:
        z = z.reshape(shape)
        differences = _transposed_differences(w_x * np.diff(z, axis=1), w_y * np.diff(z, axis=0))
        return np.asarray((differences + whisper * z).ravel())

    def preconditioner(r: Array) -> Array:
        return np.asarray(_solve_poisson(r.reshape(shape), eigenvalues).ravel() + r.mean())

    size = right_side.size
    solution, _ = cg(
        LinearOperator((size, size), matvec=matrix, dtype=np.float64),
        right_side.ravel(),
        rtol=tolerance,
        maxiter=500,
        M=LinearOperator((size, size), matvec=preconditioner, dtype=np.float64),
    )
    return np.asarray(solution.reshape(shape))


def depth_sigma(normal_sigma: Array, pitch: float, rng: np.random.Generator, n_draws: int = 12) -> Array:
    """Propagate the normals' noise through the integration by drawing from it.

    Noise is taken as independent from pixel to pixel; a systematic error of the normals (a tilt, a bowl)
    is not in it.

    Parameters
    ----------
    normal_sigma : ndarray, shape (height, width)
        One standard deviation per tangent axis, rad; NaN = hole.
    pitch : float
        Millimetres.
    rng : numpy.random.Generator
    n_draws : int
        More draws make the map smoother: its own relative error is about 1 / sqrt(2 n_draws).

    Returns
    -------
    ndarray, shape (height, width)
        One standard deviation of depth, mm.
    """
    valid = np.isfinite(normal_sigma)
    sigma = np.where(valid, normal_sigma, 0.0)
    total = np.zeros(normal_sigma.shape)
    for _ in range(n_draws):
        noise = sigma * rng.standard_normal((2, *sigma.shape))
        total += integrate_slopes(noise[0], noise[1], valid, pitch, 1e-3) ** 2
    return np.where(valid, np.sqrt(total / n_draws), np.nan)
