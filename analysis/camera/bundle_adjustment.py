"""Bundle adjustment: intrinsics, poses and the boards' places that together explain the corners best.

Minimises, over a lens p = pi(X; theta), poses (R_v, t_v), board places (Q_b, q_b) and what the print of each
corner is off by, delta_k,

    sum_vk w_vk | x_vk - pi(R_v (Q_b y_k + q_b + delta_k) + t_v; theta) |^2 / sigma_vk^2
        + sum_k | delta_k |^2 / tau^2 ,

by Levenberg-Marquardt with each view's six unknowns eliminated by the Schur complement [triggs1999]. The
weights w are Huber's. sigma_vk^2 is the corner's own variance plus a floor for what the lens model leaves
over, tau the scatter of the print; both are found from the corners themselves [mackay1992]. An error of the
print is the same in every view and does not average out, which a sigma that leaves it out forgets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from analysis.camera.board_detection import BoardCorners
from analysis.camera.board_layout import BoardLayout, cross_matrix, rotation_from_vector
from analysis.camera.lens import LENS_NAMES, Lens

Array = NDArray[np.float64]

HUBER = 3.0

MIN_FLOOR_PX = 0.003
"""Sigma per axis that no corner is better than."""

MIN_PRINT_PX = 0.005
"""The same of the print, in pixels of the picture: the drawing it is compared with is no better either."""

_FIRST_FLOOR_PX, _FIRST_PRINT_PX = 0.05, 0.02

_NOISE_ROUNDS, _NOISE_SETTLED = 8, 0.05

_MAX_STEPS = 60

_TOLERANCE = 1e-7


@dataclass(frozen=True, slots=True)
class Freedom:
    """What may move, beside the poses and the corners on their boards.

    Attributes
    ----------
    lens : tuple of str
        Names of `LENS_NAMES`.
    boards : ndarray of bool, shape (n_boards,)
        Boards whose place is adjusted.
    """

    lens: tuple[str, ...]
    boards: NDArray[np.bool_]

    @property
    def lens_index(self) -> NDArray[np.int64]:
        """Places of the free unknowns among `LENS_NAMES`."""
        return np.array([LENS_NAMES.index(name) for name in self.lens], np.int64)

    @property
    def n_rigid(self) -> int:
        """Unknowns of the lens and of the boards."""
        return len(self.lens) + 6 * int(self.boards.sum())


@dataclass(frozen=True, slots=True)
class State:
    """Values of all unknowns.

    Attributes
    ----------
    lens : Lens
    layout : BoardLayout
    rotation, translation : ndarray, shapes (n_views, 3, 3) and (n_views, 3)
        Sample to camera, mm.
    """

    lens: Lens
    layout: BoardLayout
    rotation: Array
    translation: Array


@dataclass(frozen=True, slots=True)
class CornerNoise:
    """How far corners are off.

    Attributes
    ----------
    floor : float
        Sigma per axis that is added (in squares) to each corner's own, pixels.
    print_sigma : float
        Tau: sigma per axis of the corners on the boards, mm.
    """

    floor: float
    print_sigma: float


@dataclass(frozen=True, slots=True)
class Bundle:
    """A solution.

    Attributes
    ----------
    state : State
    freedom : Freedom
    noise : CornerNoise
    residuals : tuple of ndarray, each of shape (n_corners, 2)
        Found minus predicted, pixels.
    covariance : ndarray, shape (n_rigid, n_rigid)
        Of the free lens unknowns, then of turn (rad) and shift (mm) of each free board.
    pose_covariance : ndarray, shape (n_views, 6, 6)
        Of turn (rad, camera frame) and translation (mm).
    own_pose_covariance : ndarray, shape (n_views, 6, 6)
        The same with lens and boards as they are: what shifts one view against the others.
    converged : bool
    """

    state: State
    freedom: Freedom
    noise: CornerNoise
    residuals: tuple[Array, ...]
    covariance: Array
    pose_covariance: Array
    own_pose_covariance: Array
    converged: bool

    @property
    def lens_sigma(self) -> dict[str, float]:
        """One standard deviation of each free unknown of the lens."""
        sigma = np.sqrt(np.diag(self.covariance))
        return {name: float(s) for name, s in zip(self.freedom.lens, sigma, strict=False)}


def adjust(corners: Sequence[BoardCorners], start: State, freedom: Freedom, noise: CornerNoise | None = None) -> Bundle:
    """Find the state that explains the corners best.

    Parameters
    ----------
    corners : sequence of BoardCorners
        One a view.
    start : State
    freedom : Freedom
    noise : CornerNoise or None
        None = found from the corners.
    """
    mm_per_px = float(np.median(start.translation[:, 2])) / start.lens.values[0]
    level = noise or CornerNoise(_FIRST_FLOOR_PX, _FIRST_PRINT_PX * mm_per_px)
    state, converged = start, False
    for _ in range(1 if noise else _NOISE_ROUNDS):
        state, converged = _minimise(corners, state, freedom, level)
        if noise is None:
            previous, level = level, _noise(corners, state, freedom, level, mm_per_px)
            change = np.log([level.floor / previous.floor, level.print_sigma / previous.print_sigma])
            if np.abs(change).max() < _NOISE_SETTLED:
                break
    system = _System.of(corners, state, freedom, level)
    return Bundle(state, freedom, level, system.residuals, *system.covariances(freedom.n_rigid), converged)


def _minimise(
    corners: Sequence[BoardCorners], state: State, freedom: Freedom, noise: CornerNoise
) -> tuple[State, bool]:
    """Levenberg-Marquardt; returns the state and whether it settled."""
    damping = 1e-4
    system = _System.of(corners, state, freedom, noise)
    for _ in range(_MAX_STEPS):
        candidate = system.step(state, freedom, damping)
        there = _System.of(corners, candidate, freedom, noise)
        gain = system.loss - there.loss
        if gain >= 0.0 and np.isfinite(there.loss):
            state, system, damping = candidate, there, max(0.1 * damping, 1e-12)
            if gain <= _TOLERANCE * system.loss:
                return state, True
        else:
            damping *= 10.0
            if damping > 1e10:
                return state, True
    return state, False


def _noise(
    corners: Sequence[BoardCorners], state: State, freedom: Freedom, noise: CornerNoise, mm_per_px: float
) -> CornerNoise:
    """Return the noise that the residuals and the displacements have, the degrees of freedom taken into account."""
    system = _System.of(corners, state, freedom, noise)
    delta = state.layout.displacement
    left = np.trace(system.global_covariance()[freedom.n_rigid :, freedom.n_rigid :]) / noise.print_sigma**2
    n_known = max(delta.size - float(left), 1.0)
    print_sigma = max(np.sqrt(np.sum(delta**2) / n_known), MIN_PRINT_PX * mm_per_px)
    squares = np.concatenate([np.sum(r**2, axis=1) for r in system.residuals])
    own = np.concatenate([own_variance(c) for c in corners])
    n = 2 * len(squares)
    n_unknowns = 6 * len(corners) + freedom.n_rigid + n_known
    # Median of a chi-square of two degrees, and the degrees of freedom that the fit took.
    seen = np.median(squares) / 1.386 * n / max(n - n_unknowns, 1)
    return CornerNoise(float(np.sqrt(max(seen - np.median(own), MIN_FLOOR_PX**2))), float(print_sigma))


def own_variance(corners: BoardCorners) -> Array:
    """Return each corner's variance per axis from the noise of its picture, shape (n,), pixels squared."""
    return np.asarray(0.5 * np.trace(corners.covariance, axis1=1, axis2=2))


@dataclass(frozen=True, slots=True)
class _System:
    """Normal equations: for each view A (6, 6), B (6, n_global) and a; C (n_global, n_global) and c of all."""

    loss: float
    residuals: tuple[Array, ...]
    A: Array
    B: Array
    C: Array
    a: Array
    c: Array
    prior_pull: Array

    @classmethod
    def of(cls, corners: Sequence[BoardCorners], state: State, freedom: Freedom, noise: CornerNoise) -> _System:
        n_rigid, n_print = freedom.n_rigid, 3 * len(state.layout.board)
        n_global, n_views = n_rigid + n_print, len(corners)
        A, B, a = np.zeros((n_views, 6, 6)), np.zeros((n_views, 6, n_global)), np.zeros((n_views, 6))
        C, c = np.zeros((n_global, n_global)), np.zeros((n_views, n_global))
        delta = state.layout.displacement.ravel()
        loss, residuals = 0.5 * float(delta @ delta) / noise.print_sigma**2, []
        for v, found in enumerate(corners):
            view = _ViewEquations.of(found, state, freedom, v, noise.floor)
            loss += view.loss
            residuals.append(view.residual)
            place = n_rigid + 3 * found.corner[:, None] + np.arange(3)
            Q, by_rest = view.by_corner, np.concatenate([view.by_pose, view.by_rigid], axis=2)
            rest, error = by_rest.reshape(-1, 6 + n_rigid), view.error.reshape(-1)
            N, y = rest.T @ rest, rest.T @ error
            A[v], B[v, :, :n_rigid], a[v] = N[:6, :6], N[:6, 6:], y[:6]
            C[:n_rigid, :n_rigid] += N[6:, 6:]
            c[v, :n_rigid] = y[6:]
            cross = np.swapaxes(np.swapaxes(by_rest, 1, 2) @ Q, 0, 1)
            B[v][:, place] = cross[:6]
            C[:n_rigid, place] += cross[6:]
            Q_t = np.swapaxes(Q, 1, 2)
            C[place[:, :, None], place[:, None, :]] += Q_t @ Q
            c[v, place] = (Q_t @ view.error[..., None])[..., 0]
        C[n_rigid:, :n_rigid] = C[:n_rigid, n_rigid:].T
        C[np.arange(n_rigid, n_global), np.arange(n_rigid, n_global)] += 1.0 / noise.print_sigma**2
        hold = _gauge(state.layout, freedom, sum(len(f) for f in corners))
        C[:n_rigid, :n_rigid] += hold.T @ hold
        prior_pull = np.concatenate([np.zeros(n_rigid), -delta / noise.print_sigma**2])
        return cls(loss, tuple(residuals), A, B, C, a, c, prior_pull)

    def step(self, state: State, freedom: Freedom, damping: float) -> State:
        """Return the state after one damped step."""
        A = self.A + damping * self.A * np.eye(6)
        A_inv_B = np.asarray(np.linalg.solve(A, self.B), np.float64)
        A_inv_a = np.linalg.solve(A, self.a[..., None])[..., 0]
        S = self.C + damping * np.diag(np.diag(self.C)) - _summed(self.B, A_inv_B)
        pull = self.prior_pull + self.c.sum(axis=0) - np.einsum("vij,vi->j", self.B, A_inv_a)
        g = _solve(S, pull)
        p = A_inv_a - A_inv_B @ g
        n_lens, n_rigid = len(freedom.lens), freedom.n_rigid
        values = state.lens.values.copy()
        values[freedom.lens_index] += g[:n_lens]
        move = np.zeros((len(freedom.boards), 6))
        move[freedom.boards] = g[n_lens:n_rigid].reshape(-1, 6)
        return State(
            Lens(values),
            state.layout.moved(move[:, :3], move[:, 3:], g[n_rigid:].reshape(-1, 3)),
            rotation_from_vector(p[:, :3]) @ state.rotation,
            state.translation + p[:, 3:],
        )

    def global_covariance(self) -> Array:
        """Return the covariance of all that the views share, from the noise alone."""
        return _inverse(self.C - _summed(self.B, np.asarray(np.linalg.solve(self.A, self.B), np.float64)))

    def covariances(self, n_rigid: int) -> tuple[Array, Array, Array]:
        """Return the covariance of lens and boards, of each view's pose, and of that with lens and boards held."""
        A_inv = np.asarray(np.linalg.inv(self.A), np.float64)
        A_inv_B = A_inv @ self.B
        S_inv = self.global_covariance()
        # What each view pulls with: views that pull harder than their noise have errors in common [huber1967].
        pull = (self.c - np.einsum("vij,vi->vj", A_inv_B, self.a)) @ S_inv
        n_views = len(pull)
        seen = np.sum(pull**2, axis=0) * n_views / max(n_views - 1, 1)
        known = np.diag(S_inv)
        wider = np.sqrt(np.maximum(seen / np.maximum(known, 1e-300), 1.0))
        wider[n_rigid:] = 1.0
        S_inv = S_inv * wider * wider[:, None]
        return S_inv[:n_rigid, :n_rigid], A_inv + A_inv_B @ S_inv @ np.swapaxes(A_inv_B, 1, 2), A_inv


@dataclass(frozen=True, slots=True)
class _ViewEquations:
    """One view's residuals over their sigmas, robustly weighted, and their derivatives."""

    loss: float
    residual: Array
    error: Array
    by_pose: Array
    by_rigid: Array
    by_corner: Array

    @classmethod
    def of(cls, corners: BoardCorners, state: State, freedom: Freedom, v: int, floor: float) -> _ViewEquations:
        turned = state.layout.points(corners.corner) @ state.rotation[v].T
        pixels, by_point, by_lens = state.lens.project(turned + state.translation[v])
        residual = corners.image_points - pixels
        sigma = np.sqrt(own_variance(corners) + floor**2)
        length = np.linalg.norm(residual, axis=1) / sigma
        loss = np.where(length <= HUBER, 0.5 * length**2, HUBER * (length - 0.5 * HUBER))
        weight = (np.sqrt(np.minimum(1.0, HUBER / np.maximum(length, 1e-12))) / sigma)[:, None, None]
        by_sample = by_point @ state.rotation[v]
        by_pose = np.concatenate([by_point @ -cross_matrix(turned), by_point], axis=2)
        by_rigid = _by_rigid(corners, state.layout, freedom, by_sample, by_lens)
        return cls(
            float(loss.sum()), residual, residual * weight[..., 0], by_pose * weight, by_rigid * weight,
            by_sample * weight,
        )  # fmt: skip


def _summed(B: Array, A_inv_B: Array) -> Array:
    """Return sum_v B_v' A_v^-1 B_v."""
    flat = B.reshape(-1, B.shape[-1])
    return np.asarray(flat.T @ A_inv_B.reshape(-1, B.shape[-1]))


def _solve(S: Array, y: Array) -> Array:
    """Solve S x = y, scaled to a unit diagonal: k3 and f differ by many orders."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    unit = S * scale * scale[:, None]
    try:
        x = np.asarray(cho_solve(cho_factor(unit, check_finite=False), scale * y, check_finite=False))
    except LinAlgError:
        # Something that no corner holds, such as the place of a board not seen.
        x = np.asarray(np.linalg.lstsq(unit, scale * y, rcond=1e-13)[0])
    return np.asarray(scale * x)


def _inverse(S: Array) -> Array:
    """Invert, scaled to a unit diagonal."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    return np.asarray(scale * np.linalg.pinv(S * scale * scale[:, None], rcond=1e-13, hermitian=True) * scale[:, None])


def _by_rigid(corners: BoardCorners, layout: BoardLayout, freedom: Freedom, by_sample: Array, by_lens: Array) -> Array:
    """Return the derivatives of pixels by the lens and by turn and shift of the free boards, shape (n, 2, n_rigid)."""
    n_lens = len(freedom.lens)
    G = np.zeros((len(corners), 2, freedom.n_rigid))
    G[..., :n_lens] = by_lens[..., freedom.lens_index]
    by_turn = by_sample @ -cross_matrix(layout.arms(corners.corner))
    for place, b in enumerate(np.flatnonzero(freedom.boards)):
        on = layout.board[corners.corner] == b
        first = n_lens + 6 * place
        G[on, :, first : first + 3] = by_turn[on]
        G[on, :, first + 3 : first + 6] = by_sample[on]
    return G


def _gauge(layout: BoardLayout, freedom: Freedom, n: int) -> Array:
    """Rows that hold all boards together where they were: their corners neither shift nor turn in the mean.

    If any board is held, that one is the gauge and no row is needed.
    """
    if not freedom.boards.all() or not len(freedom.boards):
        return np.zeros((0, freedom.n_rigid))
    every = np.arange(len(layout.board))
    X = layout.points(every) - layout.points(every).mean(axis=0)
    size = float(np.sqrt(np.mean(X**2)))
    by_point = np.concatenate([np.broadcast_to(np.eye(3), (len(X), 3, 3)), cross_matrix(X) / size], axis=1)
    by_turn = by_point @ -cross_matrix(layout.arms(every))
    rows = np.zeros((6, freedom.n_rigid))
    for b in range(len(freedom.boards)):
        first = len(freedom.lens) + 6 * b
        rows[:, first : first + 3] = by_turn[layout.board == b].sum(axis=0)
        rows[:, first + 3 : first + 6] = by_point[layout.board == b].sum(axis=0)
    # Stiff against what the corners know, which is some thousandths of a millimetre.
    return rows * 1e3 * n / len(X)


def drop(bundle: Bundle, names: tuple[str, ...]) -> tuple[State, Freedom]:
    """Return a start with the lens unknowns `names` held at nothing (aspect 1, distortion 0)."""
    values = bundle.state.lens.values.copy()
    for name in names:
        values[LENS_NAMES.index(name)] = 1.0 if name == "aspect" else 0.0
    free = tuple(name for name in bundle.freedom.lens if name not in names)
    return replace(bundle.state, lens=Lens(values)), replace(bundle.freedom, lens=free)
