"""Pictures that real cameras took; skipped where they are missing."""

import os
from pathlib import Path

import numpy as np
import pytest

from instrument.imports.prepare import prepare_import
from instrument.imports.writing import write_import
from instrument.session.session import Session
from tests.instrument.imports.folders import write_capture
from tests.verifying import verify_session

SHARED = Path(os.environ.get("HALFANGLE_SHARED_DATA", Path(__file__).parents[4] / "shared" / "data"))
CHECKERBOARDS = Path("/usr/share/doc/opencv-doc/examples/data")


def imported(source: Path, folder: Path, text: str) -> Session:
    if not source.is_dir():
        pytest.skip(f"the real pictures are not at {source}; set HALFANGLE_SHARED_DATA")
    write_import(prepare_import(source, write_capture(folder, text)), folder / "s.h5")
    assert list(verify_session(folder / "s.h5")) == []
    return Session(folder / "s.h5")


def test_a_raw_file_of_a_canon_has_its_levels(tmp_path: Path) -> None:
    text = 'name = "chart"\n[grouping]\nglob = "*.dng"\nexposure_times_s = [0.01]\n'
    with imported(SHARED / "raw", tmp_path, text) as session:
        camera = session.camera
        assert (camera.make, camera.bit_depth, camera.bayer_pattern) == ("Canon", 14, "RGGB")
        assert (camera.black_level, camera.saturation_value) == (2056, 15000)
        # 1888 x 1182 with the masked border, which the file's active area leaves out.
        assert (camera.width, camera.height) == (1734, 1156)
        counts = session.frame(0, 0)
        assert camera.black_level < np.median(counts) < camera.saturation_value


def test_a_phones_flash_picture_comes_with_ambient_light_and_a_response_bracket(tmp_path: Path) -> None:
    text = """
name = "towel"
linear = false
response = { bracket = { files = ["colorcard_low/*.jpg"] } }
flats = { files = ["greycard_low.jpg"], distance_mm = 200 }
[[poses]]
files = ["green_towel_low/point.jpg"]
ambient = ["green_towel_low/ambient.jpg"]
"""
    with imported(SHARED / "phone_flash", tmp_path, text) as session:
        assert session.camera.make == "HUAWEI"
        assert session.camera.frame_shape == (600, 800, 3)
        assert session.exposure_readback.tolist() == [[0.1]]
        assert session.extra.ambient_times.tolist() == [0.02]
        assert session.extra.flat_distances_mm.tolist() == [200]
        times = [1 / 1000, 1 / 500, 1 / 250, 1 / 125, 1 / 60, 1 / 30, 1 / 15, 1 / 6, 0.3, 0.6]
        np.testing.assert_allclose(session.extra.response_times, times, rtol=0.02)
        means = [session.extra.response_images(i).mean() for i in range(10)]
        assert means == sorted(means)


def test_grey_checkerboards_without_a_time_become_poses(tmp_path: Path) -> None:
    text = """
name = "checkerboards"
linear = true
grouping = { glob = "left??.jpg", exposure_times_s = [1.0] }
[[boards]]
kind = "checkerboard"
squares = [10, 7]
square_mm = 25.0
corner_mm = "measure"
"""
    with imported(CHECKERBOARDS, tmp_path, text) as session:
        assert session.n_poses == 13
        assert session.camera.frame_shape == (480, 640)
        assert session.camera.bayer_pattern == ""
        assert [(board.kind, board.squares) for board in session.nominal.boards] == [("checkerboard", (10, 7))]
