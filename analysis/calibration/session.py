"""Calibrates a session from its own pictures: lens, poses, boards, light and the light's powers.

Frames are merged as often as they are needed, so that no more than one merged picture is in memory at a
time, whatever the number of poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.light import Lighting, find_light
from analysis.camera.board_detection import BoardCorners, detect_corners, detection_image
from analysis.camera.board_findings import BoardFindings, board_findings
from analysis.camera.board_layout import BoardLayout
from analysis.camera.board_statement import (
    MarkerEvidence,
    counted_by_inner_corners,
    marker_evidence,
    mirrored,
    old_patterns,
    other_board,
)
from analysis.camera.calibration import MIN_VIEWS, CameraCalibration, calibrate_camera, usable_views
from analysis.camera.lens import Lens
from analysis.light.flat_field import FlatField, session_flat_field
from analysis.radiometry.conversion import RadiometryFindings
from analysis.radiometry.frames import MergedFrames
from analysis.stages import Stages
from instrument.files.validation import InvalidInputError, Problem
from instrument.session.session import Session

Array = NDArray[np.float64]

_FIRST_VIEWS = 10
"""Views that the lens is first found from; corners are measured through it in all of them."""


@dataclass(frozen=True)
class Calibration:
    """What a session's own pictures say of the rig.

    Attributes
    ----------
    radiometry : RadiometryFindings
        How counts became radiance.
    flat : FlatField or None
        From the session's pictures of a card; None if there are none.
    camera : CameraCalibration or None
        None without boards.
    boards : BoardFindings or None
    lighting : Lighting or None
        None where no area is stated: then there is nothing to light.
    i_pose : ndarray of int, shape (n_views,)
        The session's pose of each view that shows the boards.
    dropped : tuple of str
        Poses that were left out, with the reason.
    """

    radiometry: RadiometryFindings
    flat: FlatField | None
    camera: CameraCalibration | None
    boards: BoardFindings | None
    lighting: Lighting | None
    i_pose: NDArray[np.int64]
    dropped: tuple[str, ...]

    @property
    def distance_mm(self) -> float | None:
        """Median distance of the camera from the centre of the sample, mm; None without boards."""
        if self.camera is None:
            return None
        return float(np.median(np.linalg.norm(self.camera.camera_position, axis=1)))

    def as_dict(self) -> dict[str, object]:
        """Return the figures that a report shows."""
        figures: dict[str, object] = {"n_views": len(self.i_pose), "dropped": list(self.dropped)}
        if self.camera is not None:
            figures |= _camera_figures(self.camera)
        if self.lighting is not None:
            figures |= _light_figures(self.lighting)
        return figures


def _camera_figures(camera: CameraCalibration) -> dict[str, object]:
    matrix = camera.camera_matrix
    return {
        "corner_rms_px": camera.rms,
        "n_corner_outliers": len(camera.outliers),
        "fx_px": float(matrix[0, 0]),
        "fy_px": float(matrix[1, 1]),
        "cx_px": float(matrix[0, 2]),
        "cy_px": float(matrix[1, 2]),
        "distortion": camera.distortion.tolist(),
        "sigma_px": camera.intrinsics_sigma,
        "print_sigma_mm": camera.bundle.noise.print_sigma,
    }


def _light_figures(lighting: Lighting) -> dict[str, object]:
    photometry, offset = lighting.photometry, lighting.light_offset
    return {
        "light_offset_mm": offset.value.tolist(),
        "light_offset_sigma_mm": offset.sigma.tolist(),
        "light_power_spread": float(np.std(photometry.light_power) / np.mean(photometry.light_power)),
        "light_power_sigma": float(np.sqrt(np.mean(photometry.light_power_sigma**2))),
        "vignetting": list(photometry.vignetting),
        "light_gradient": list(photometry.gradient),
        "lobe_exponent": photometry.lobe_exponent,
        "white_rms": photometry.rms,
    }


def calibrate_session(session: Session, frames: MergedFrames, stages: Stages) -> Calibration:
    """Calibrate a session from its own pictures, as far as they and what is stated of them allow.

    Parameters
    ----------
    session : Session
    frames : MergedFrames
    stages : Stages

    Raises
    ------
    InvalidInputError
        If there are boards, and too few poses show them.
    """
    camera, boards, i_pose = None, None, np.zeros(0, np.int64)
    dropped: tuple[str, ...] = ()
    if session.nominal.boards:
        with stages.measure("boards"):
            found = _find_boards(session, frames, stages)
        usable = usable_views(found)
        dropped = tuple(
            f"pose {i}: {len(c)} board corners" for i, c, ok in zip(frames.i_pose, found, usable, strict=True) if not ok
        )
        stated = session.nominal.boards
        legacy = frozenset.union(frozenset(), *(c.legacy for c in found))
        markers = marker_evidence(stated, [c.markers for c in found], legacy)
        with stages.measure("camera"):
            corners = [c for c, ok in zip(found, usable, strict=True) if ok]
            if len(corners) < MIN_VIEWS:
                _refuse_other_boards(session, frames, markers)
            nominal = BoardLayout.nominal(stated)
            camera = calibrate_camera(
                corners, frames.image_size, nominal, session.nominal.focal_length_px, _known(session)
            )
        boards = board_findings(camera.bundle, nominal, legacy, markers)
        i_pose = frames.i_pose[usable]
    with stages.measure("light"):
        flat = _flat_field(session, frames, camera)
        lighting = None
        if camera is not None and boards is not None and session.nominal.area_mm is not None:
            lighting = find_light(session, frames, i_pose, camera, boards.legacy, flat, stages.track)
    return Calibration(frames.findings, flat, camera, boards, lighting, i_pose, dropped)


def _known(session: Session) -> Lens | None:
    """Return the intrinsics that somebody stated; those that come from the pictures are better if there are enough."""
    matrix, distortion = session.nominal.camera_matrix, session.nominal.distortion
    few = int(session.pose_complete.sum()) < MIN_VIEWS
    if matrix is None or not few:
        return None
    return Lens.of(matrix, np.zeros(5) if distortion is None else distortion)


def _flat_field(session: Session, frames: MergedFrames, camera: CameraCalibration | None) -> FlatField | None:
    offset = np.zeros(3) if session.nominal.light_offset_mm is None else session.nominal.light_offset_mm
    focal_length = session.nominal.focal_length_px if camera is None else float(camera.camera_matrix[0, 0])
    # Without any, a field of view of 60 deg: of the card only the product over the picture is wanted then.
    return session_flat_field(frames, focal_length or 0.87 * max(frames.image_size), offset)


def _find_boards(session: Session, frames: MergedFrames, stages: Stages) -> list[BoardCorners]:
    """Find the corners twice in a few views, to know lens and pattern, and then with these in all."""
    picked = frames.i_pose[np.unique(np.linspace(0, len(frames.i_pose) - 1, _FIRST_VIEWS).round().astype(int))]
    first = [_detect(session, frames, int(i), None, None) for i in stages.track(picked.tolist())]
    legacy = old_patterns(session.nominal.boards, [c.markers for c in first])
    lens = _first_lens(session, frames, [c for c in first if all((k in c.legacy) == old for k, old in legacy.items())])
    return [_detect(session, frames, int(i), lens, legacy) for i in stages.track(frames.i_pose.tolist())]


def _first_lens(session: Session, frames: MergedFrames, found: list[BoardCorners]) -> Lens | None:
    found = [c for c, ok in zip(found, usable_views(found), strict=True) if ok]
    if len(found) < MIN_VIEWS:
        return None
    layout = BoardLayout.nominal(session.nominal.boards)
    return calibrate_camera(found, frames.image_size, layout, session.nominal.focal_length_px).bundle.state.lens


def _refuse_other_boards(session: Session, frames: MergedFrames, markers: tuple[MarkerEvidence | None, ...]) -> None:
    """Raise where boards are hardly found, and the pictures tell why."""
    stated = session.nominal.boards
    problems = [
        Problem(f"board {k}", f"{told}; state it so") for k, told in enumerate(map(other_board, markers)) if told
    ]
    shown, bound = _grey(frames, int(frames.i_pose[0]))
    image = detection_image(np.where(bound, np.float32(np.nan), shown), frames.bayer_pattern)
    if mirrored(image, stated):
        problems.append(Problem("boards", "the pictures show them mirrored; turn the pictures round, left for right"))
    for k, board in enumerate(stated):
        if board.kind == "checkerboard" and counted_by_inner_corners(image, board):
            squares = [n + 1 for n in board.squares]
            problems.append(Problem(f"board {k}", f"the picture fits squares = {squares}; count squares, not corners"))
    if problems:
        raise InvalidInputError("The camera cannot be calibrated.", problems)


def _detect(
    session: Session, frames: MergedFrames, i_pose: int, lens: Lens | None, legacy: dict[int, bool] | None
) -> BoardCorners:
    grey, bound = _grey(frames, i_pose)
    return detect_corners(grey, frames.bayer_pattern, session.nominal.boards, lens, bound, legacy)


def _grey(frames: MergedFrames, i_pose: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return a pose's picture, and where it is a lower bound only."""
    merged = frames.merge(i_pose)
    if merged.mean.ndim == 2:
        return merged.mean, merged.saturated
    # Boards are black and white: the mean of the colours shows them with the least noise.
    return merged.mean.mean(axis=-1), np.asarray(merged.saturated.any(axis=-1))
