"""Thirteen real pictures of a checkerboard with a published calibration (OpenCV's samples, package opencv-doc).

Published: f = 535.916 (one for both axes), c = (342.283, 235.571), 0.3926 px; it took the print as perfect. Its
sigmas are those that OpenCV states for the same procedure on the same corners: 0.88, 0.93 and 1.01 px.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.camera.board_detection import detect_corners
from analysis.camera.board_findings import board_findings
from analysis.camera.board_layout import BoardLayout
from analysis.camera.calibration import CameraCalibration, calibrate_camera
from instrument.session.records import Board

FOLDER = Path("/usr/share/doc/opencv-doc/examples/data")
PUBLISHED = {"f": (535.916, 0.88), "cx": (342.283, 0.93), "cy": (235.571, 1.01)}
BOARD = (Board("checkerboard", "", 0, (10, 7), 25.0, 0.0, (-125.0, 87.5)),)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (FOLDER / "left01.jpg").exists(), reason="package opencv-doc is not installed"),
]


@pytest.fixture(scope="module")
def calibration() -> CameraCalibration:
    files = sorted(FOLDER.glob("left[01]*.jpg"))
    assert len(files) == 13
    pictures = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE).astype(np.float32) for file in files]
    layout = BoardLayout.nominal(BOARD)
    first = calibrate_camera([detect_corners(p, "", BOARD) for p in pictures], (640, 480), layout)
    lens = first.bundle.state.lens
    return calibrate_camera([detect_corners(p, "", BOARD, lens) for p in pictures], (640, 480), layout)


def test_every_corner_is_found_and_few_are_left_out(calibration: CameraCalibration):
    assert sum(len(c) for c in calibration.corners) + len(calibration.outliers) >= 13 * 54 - 2
    assert len(calibration.outliers) < 0.05 * 13 * 54


def test_the_reprojection_error_is_no_larger_than_published(calibration: CameraCalibration):
    assert calibration.rms < 0.3926


def test_the_intrinsics_agree_with_the_published_ones_within_their_sigmas(calibration: CameraCalibration):
    matrix, sigma = calibration.camera_matrix, calibration.intrinsics_sigma
    found = {"f": 0.5 * (matrix[0, 0] + matrix[1, 1]), "cx": matrix[0, 2], "cy": matrix[1, 2]}
    for name, (value, its_sigma) in PUBLISHED.items():
        assert abs(found[name] - value) < 2.0 * np.hypot(sigma[name], its_sigma), name


def test_the_print_is_found_to_be_off_by_less_than_a_tenth_of_a_millimetre(calibration: CameraCalibration):
    findings = board_findings(calibration.bundle, BoardLayout.nominal(BOARD), frozenset())
    assert 0.03 < calibration.bundle.noise.print_sigma < 0.1
    assert findings.out_of_plane[0] < 0.5
