"""Boards that are not as stated, and where pictures land on the sample's plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.camera.board_detection import detect_corners
from analysis.camera.board_findings import board_findings
from analysis.camera.board_layout import BoardLayout
from analysis.pixels.parallax import follow_pixels
from instrument.session.records import Board
from tests.analysis import board_pictures as pictures
from tests.analysis.camera import test_calibration as bundle
from tests.analysis.registration.test_rectification import checker_shift
from tests.checks.conftest import Record
from tests.checks.worlds import NeutralWorld


@pytest.mark.check(11)
@pytest.mark.parametrize("legacy", [True, False])
def test_the_pattern_of_older_opencv_is_recognised(record: Record, legacy: bool) -> None:
    found = detect_corners(pictures.photograph(*pictures.POSES[1], legacy=legacy), "", pictures.BOARDS)
    assert len(found) == 50
    record.holds(
        f"{'legacy' if legacy else 'new'} pattern reported as such", found.legacy == ({0, 1} if legacy else set())
    )


@pytest.mark.check(11)
def test_squares_of_another_size_than_stated_are_found(record: Record) -> None:
    centres = np.repeat([bundle.TRUE[9 * k : 9 * k + 9].mean(axis=0) for k in range(4)], 9, axis=0)
    smaller = centres + 0.99 * (bundle.TRUE - centres)
    calibration = bundle.calibrated(bundle.corners_from(smaller, np.random.default_rng(2)), focal_length_px=850.0)
    findings = board_findings(calibration.bundle, BoardLayout.nominal(bundle.BOARDS), frozenset())
    off = abs(0.99 * findings.scale - 1.0)
    record.at_most("size of squares 1 % too small, from the boards' distances, error", 100.0 * off, 0.2, "%")
    record.at_least(
        "its distance from the stated size, in sigmas", abs(findings.scale - 1.0) / findings.scale_sigma, 3.0
    )


@pytest.mark.check(11)
def test_a_board_that_is_not_flat_is_told(record: Record) -> None:
    board = (Board("checkerboard", "", 0, (10, 7), 8.0, 0.0, (-40.0, 28.0)),)
    flat = pictures.corners_of(board[0])
    bowed = flat + [0.0, 0.0, 0.4] * (1.0 - (flat[:, :1] / 32.0) ** 2)
    plane = np.linalg.lstsq(np.column_stack([flat[:, :2], np.ones(len(flat))]), bowed[:, 2], rcond=None)[0]
    true = np.abs(bowed[:, 2] - np.column_stack([flat[:, :2], np.ones(len(flat))]) @ plane).max()
    found = []
    for corners in (bowed, flat):
        calibration = bundle.calibrated(
            bundle.corners_from(corners, np.random.default_rng(3), poses=bundle.POSES[:12]),
            board,
            focal_length_px=850.0,
        )
        findings = board_findings(calibration.bundle, BoardLayout.nominal(board), frozenset())
        found.append(findings.out_of_plane[0])
    record.at_most(
        f"distance of a board bowed by 0.4 mm from its plane, found less {true:.2f} mm", abs(found[0] - true), 0.1, "mm"
    )
    record.at_most("the same of a flat one", found[1], 0.05, "mm")


@pytest.mark.check(13)
def test_a_checker_lies_where_it_lies_in_every_pose(record: Record) -> None:
    poses = [(0.0, 0.0), *((t, a) for t in (20.0, 45.0, 60.0) for a in (0.0, 130.0, 250.0))]
    worst = max(checker_shift(*p) for p in poses)
    record.at_most("shift of a checker on the grid, worst of 10 poses and 3 colours", worst, 0.1, "px")


@pytest.mark.check(13)
def test_pictures_fit_better_along_the_depth(record: Record, neutral: NeutralWorld) -> None:
    depth, true = neutral.truth.depth, neutral.radiance()
    flat, along = neutral.stack(None), neutral.stack(depth)
    pixels = np.arange(depth.size)
    followed = replace(flat, radiance=follow_pixels(flat, depth, pixels).radiance.reshape(true.shape))

    def residual(radiance: np.ndarray) -> float:
        # The median: at borders of materials a point is no reference for a footprint.
        return float(np.nanmedian(np.abs(radiance / true - 1.0)))

    before = residual(flat.radiance)
    record.at_most(
        "residual against the truth along the depth, over that on the plane", residual(along.radiance) / before, 0.5
    )
    record.at_most("the same by moving what was registered to the plane", residual(followed.radiance) / before, 0.5)
