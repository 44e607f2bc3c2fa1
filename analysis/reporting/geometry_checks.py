"""Checks of lens and poses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.session import Calibration
from analysis.camera.board_findings import BoardFindings
from analysis.camera.board_layout import rotation_from_vector
from analysis.camera.board_statement import MOST, other_board
from analysis.camera.calibration import MIN_VIEWS, CameraCalibration
from analysis.reporting.checks import Check, Limits, Status, graded, rms, unknown
from analysis.reporting.session_facts import SessionFacts
from instrument.session.records import Board

Array = NDArray[np.float64]

OUTLIERS = Limits(0.01, 0.1, "at most 1 % of the corners; FAIL above 10 %")

HALVES = Limits(2.0, 4.0, "RMS z at most 2; FAIL above 4")

FOCAL_LENGTH = Limits(0.002, 0.02, "sigma at most 0.2 %; FAIL above 2 %")

STAGE = Limits(0.1, 1.0, "within 0.1 deg; FAIL above 1 deg")

DROPPED = Limits(0.0, 0.5, "none; FAIL above half of them")

_GOOD_RMS_PX, _BAD_RMS_PX, _NOISE_TIMES = 0.1, 0.5, 2.0

_WORST_TIMES, _HARMLESS_PX = 2.5, 0.05

FLATNESS = Limits(0.1, 1.0, "at most 0.1 mm; FAIL above 1 mm")

PLACE = Limits(0.5, np.inf, "at most 0.5 mm from where it was stated to lie")

MARKERS = Limits(0.05, 1.0 - MOST, "at least 95 %; FAIL below 80 %")

_SCALE, _SIGMAS = 0.003, 3.0


def geometry_checks(calibration: Calibration, facts: SessionFacts) -> Iterator[Check]:
    """Yield the checks of a calibration with boards; none without."""
    camera, boards = calibration.camera, calibration.boards
    if camera is None or boards is None:
        return
    yield _converged(camera)
    yield corner_rms(camera)
    yield worst_view(camera, calibration.i_pose)
    yield outliers(camera, calibration.i_pose)
    yield halves(camera)
    if "f" in camera.intrinsics_sigma:
        yield _focal_length(camera)
    yield from board_checks(boards, facts.boards)
    if facts.tilt_deg is not None and facts.turn_deg is not None:
        yield from stage(camera.rotation, facts.tilt_deg, facts.turn_deg, calibration.i_pose)
    yield _dropped(calibration, facts.n_complete)


def _converged(camera: CameraCalibration) -> Check:
    settled = camera.bundle.converged
    remedy = "do not use this calibration; look at the worst view and at the stated boards"
    number = "settled" if settled else "not settled after the last step allowed"
    return graded("adjustment", float(not settled), Limits(0.0, 0.0, "settled"), number, remedy)


def noise_rms(camera: CameraCalibration) -> float:
    """Return the RMS length that the corners' residuals would have from the noise of the pictures alone, pixels."""
    variance = np.concatenate([np.trace(c.covariance, axis1=1, axis2=2) for c in camera.corners])
    return float(np.sqrt(np.mean(variance)))


def corner_rms(camera: CameraCalibration) -> Check:
    """Compare the residuals with what the noise of the pictures explains."""
    expected = noise_rms(camera)
    warn = max(_GOOD_RMS_PX, _NOISE_TIMES * expected)
    n = sum(len(c) for c in camera.corners)
    return graded(
        "corners",
        camera.rms,
        Limits(warn, _BAD_RMS_PX, f"at most {warn:.3f} px RMS; FAIL above {_BAD_RMS_PX:g} px"),
        f"{camera.rms:.4f} px RMS over {n} corners in {len(camera.corners)} views; "
        f"noise of the pictures explains {expected:.4f} px",
        "more than noise is left: check focus, motion during the exposure, the flatness of the boards and their stated "
        "squares; see where the residuals point",
    )


def worst_view(camera: CameraCalibration, i_pose: NDArray[np.int64]) -> Check:
    """Name the view whose corners fit worst."""
    worst, usual = int(camera.view_rms.argmax()), float(np.median(camera.view_rms))
    warn = max(_WORST_TIMES * usual, _HARMLESS_PX)
    return graded(
        "worst view",
        float(camera.view_rms[worst]),
        Limits(
            warn, np.inf, f"at most {warn:.3f} px: {_WORST_TIMES:g} times the median view's, or {_HARMLESS_PX:g} px"
        ),
        f"pose {i_pose[worst]}: {camera.view_rms[worst]:.4f} px RMS, the median view has {usual:.4f} px",
        f"look at pose {i_pose[worst]}: blurred, moved or partly covered; capture it again or leave it out",
    )


def outliers(camera: CameraCalibration, i_pose: NDArray[np.int64]) -> Check:
    """Count and locate the corners that were left out."""
    n = sum(len(c) for c in camera.corners) + len(camera.outliers)
    where = Counter((int(i_pose[o.view]), o.board) for o in camera.outliers).most_common(3)
    places = ", ".join(f"{k} in pose {pose} on board {board}" for (pose, board), k in where)
    return graded(
        "corners left out",
        len(camera.outliers) / n,
        OUTLIERS,
        f"{len(camera.outliers)} of {n} corners" + (f", most of them: {places}" if places else ""),
        "look there for glare, dirt or something that covers the board",
    )


def halves(camera: CameraCalibration) -> Check:
    """Compare calibrations of both halves of the views with their predicted sigmas."""
    name, z = "two halves of the views", camera.halves_z
    if not z:
        number = f"{len(camera.corners)} views are too few to calibrate two halves"
        remedy = f"capture at least {2 * MIN_VIEWS} views of the boards"
        return unknown(name, number, HALVES.text, remedy)
    worst = max(z, key=lambda key: abs(z[key]))
    return graded(
        name,
        rms(list(z.values())),
        HALVES,
        f"differ by {rms(list(z.values())):.2f} of their predicted sigma (RMS), most in {worst} (z = {z[worst]:+.1f})",
        "something changes between the views: focus, zoom or stabilisation that moves, or boards that are not held "
        "down. The stated sigmas are widened by this much",
    )


def _focal_length(camera: CameraCalibration) -> Check:
    f, sigma = float(camera.camera_matrix[1, 1]), camera.intrinsics_sigma["f"]
    return graded(
        "focal length",
        sigma / f,
        FOCAL_LENGTH,
        f"{f:.2f} ± {sigma:.2f} px",
        "add views that are tilted by 20 to 45 deg, in different directions",
    )


def stage(rotation: Array, tilt_deg: Array, turn_deg: Array, i_pose: NDArray[np.int64]) -> Iterator[Check]:
    """Compare turns between poses by the stage's reading with those that the boards show.

    A tilt about x carries a turn about z. The angle of the turn from one pose to another is the same in any frame,
    so that nothing of how stage and camera stand to each other is needed.

    Parameters
    ----------
    rotation : ndarray, shape (n_views, 3, 3)
        Sample to camera, as found.
    tilt_deg, turn_deg : ndarray, shape (n_views,)
        Read-back.
    i_pose : ndarray of int, shape (n_views,)
    """
    known = np.isfinite(tilt_deg) & np.isfinite(turn_deg)
    if known.sum() < 2:
        return
    x, _, z = np.eye(3)
    tilt, turn = (np.deg2rad(angle[known])[:, None] for angle in (tilt_deg, turn_deg))
    read = rotation_from_vector(tilt * x) @ rotation_from_vector(turn * z)
    off = np.abs(_turns(rotation[known]) - _turns(read))
    of_pose = np.median(off, axis=1)
    worst = int(of_pose.argmax())
    yield graded(
        "stage",
        float(of_pose[worst]),
        STAGE,
        f"turns between poses differ by {np.median(off):.4f} deg (median), most at pose {i_pose[known][worst]} "
        f"({of_pose[worst]:.4f} deg)",
        "poses come from the boards whatever the stage says; check its zero, its axes and whether the sample slips",
    )


def _turns(rotation: Array) -> Array:
    """Return the angle from each pose to each other, degrees, shape (n, n)."""
    trace = np.einsum("aij,bij->ab", rotation, rotation)
    return np.asarray(np.rad2deg(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))))


def _dropped(calibration: Calibration, n_complete: int) -> Check:
    n = len(calibration.dropped)
    reasons = "; ".join(calibration.dropped[:3]) + ("; ..." if n > 3 else "")
    return graded(
        "poses left out",
        n / max(n_complete, 1),
        DROPPED,
        f"{n} of {n_complete}" + (f": {reasons}" if n else ""),
        "see that the boards are in the picture, in focus and neither clipped nor dark; capture these poses again",
    )


def board_checks(boards: BoardFindings, stated: tuple[Board, ...]) -> Iterator[Check]:
    """Yield pattern, markers, scale, flatness and place of the boards."""
    yield _pattern(boards)
    if any(boards.markers):
        yield _markers(boards)
    if np.isfinite(boards.scale):
        yield _scale(boards, stated)
    worst = int(boards.out_of_plane.argmax())
    flat = float(boards.out_of_plane[worst])
    remedy = f"glue board {worst} to something flat; its shape is taken into account, with its sigma"
    number = f"{flat:.4f} mm out of plane at the worst, on board {worst}"
    yield graded("flatness of the boards", flat, FLATNESS, number, remedy)
    if len(boards.moved) > 1:
        far = int(boards.moved.argmax())
        number = f"board {far} lies {boards.moved[far]:.3f} mm from its stated place"
        remedy = f"measure corner_mm of board {far} again, or state it as to be measured; the place found is used"
        yield graded("place of the boards", float(boards.moved[far]), PLACE, number, remedy)


def _pattern(boards: BoardFindings) -> Check:
    legacy = ", ".join(map(str, sorted(boards.legacy)))
    number = f"boards {legacy} have the pattern of OpenCV before 4.6" if legacy else "as OpenCV draws it since 4.6"
    return Check("pattern of the boards", Status.PASS, f"{number}; the pattern found is used", 0.0, "told", "")


def _markers(boards: BoardFindings) -> Check:
    told = [(evidence.share, k, evidence) for k, evidence in enumerate(boards.markers) if evidence is not None]
    share, worst, evidence = min(told, key=lambda item: item[:2])
    other = other_board(evidence) or "no other size of the board explains them"
    return graded(
        "markers of the boards",
        1.0 - share,
        MARKERS,
        f"board {worst}: {evidence.n_explained} of {evidence.n_seen} lie where the stated board has them",
        f"{other}: compare squares, first_id and dictionary with the print, and state what it is",
    )


def _scale(boards: BoardFindings, stated: tuple[Board, ...]) -> Check:
    """Judge the distances between boards: beyond chance it warns, beyond chance and 0.3 % it fails."""
    off = abs(boards.scale - 1.0)
    by_chance = _SIGMAS * boards.scale_sigma
    squares = ", ".join(sorted({f"{b.square_mm / boards.scale:.3f}" for b in stated}))
    printed = ", ".join(sorted({f"{b.square_mm:g}" for b in stated}))
    return graded(
        "scale of the squares",
        off,
        Limits(by_chance, max(by_chance, _SCALE), f"within {_SIGMAS:g} sigma; FAIL beyond that and 0.3 %"),
        f"{boards.scale:.5f} ± {boards.scale_sigma:.5f} of the stated distances between the boards",
        f"if the stated places are right, the squares measure {squares} mm, not {printed}: measure ten in a row "
        "and state square_mm; all lengths follow it",
    )
