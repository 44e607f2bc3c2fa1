"""A session written as pictures and imported again is the same session."""

from dataclasses import asdict, replace
from operator import attrgetter
from pathlib import Path

import h5py
import numpy as np
import pytest

from instrument.config.loading import load_protocol, load_rig
from instrument.files.validation import InvalidInputError
from instrument.imports.export import export_session
from instrument.imports.prepare import prepare_import
from instrument.imports.writing import write_import
from instrument.pictures.reading import read_picture
from instrument.session import layout
from instrument.session.session import Session
from protocols.capture.engine import capture
from tests.instrument.imports.folders import H, W, mosaic, write_capture, write_dng, write_exr, write_jpeg, write_png
from tests.verifying import verify_session

RIG = """
name = "small bench"
camera = { driver = "simulated", width = 96, height = 72, focal_length_px = 185.0 }
light = { driver = "simulated", offset_mm = [12.0, 0.0, 0.0], offset_sigma_mm = 3.0 }
stage = { driver = "simulated" }
geometry = { working_distance_mm = 350.0, area_mm = [60.0, 60.0] }
simulation = { seed = 3 }
[[boards]]
kind = "charuco"
dictionary = "DICT_4X4_50"
first_id = 8
squares = [4, 4]
square_mm = 5.5
marker_mm = 4.4
corner_mm = [-54.0, 54.0]
"""
PROTOCOL = """
name = "three \\"views\\""
sample = "Blatt – αβ"
bracket = { exposure_times_s = [0.002, 0.05], darks = 2 }
rings = [{ tilt_deg = 25.0, count = 3, start_deg = 10.0 }]
"""


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("captured")
    (folder / "rig.toml").write_text(RIG)
    (folder / "protocol.toml").write_text(PROTOCOL)
    capture(load_rig(folder / "rig.toml"), load_protocol(folder / "protocol.toml"), folder / "s.h5")
    return folder / "s.h5"


def round_trip(path: Path, folder: Path) -> Path:
    """Export the session `path`, import what was written, and return the new session."""
    with Session(path) as session:
        export_session(session, folder / "pictures")
    back = folder / "back.h5"
    write_import(prepare_import(folder / "pictures", folder / "pictures" / "capture.toml"), back)
    assert list(verify_session(back)) == []
    return back


def imported(folder: Path, text: str) -> Path:
    write_import(prepare_import(folder, write_capture(folder, text)), folder / "s.h5")
    return folder / "s.h5"


def assert_same(first: Path, second: Path) -> None:
    with Session(first) as one, Session(second) as two:
        assert one.frame_digests == two.frame_digests
        assert (one.title, one.sample) == (two.title, two.sample)
        assert str(replace(one.camera)) == str(replace(two.camera))
        assert [str(asdict(board)) for board in one.nominal.boards] == [
            str(asdict(board)) for board in two.nominal.boards
        ]
        for name in (
            "exposure_times",
            "exposure_readback",
            "frame_ok",
            "dark",
            "nominal.area_mm",
            "nominal.pixel_pitch_mm",
            "nominal.working_distance_mm",
            "nominal.focal_length_px",
            "nominal.light_offset_mm",
            "nominal.light_offset_sigma_mm",
            "nominal.camera_matrix",
            "nominal.distortion",
            "nominal.black_level_cell",
            "nominal.response",
            "extra.response_times",
            "extra.flat_times",
            "extra.flat_distances_mm",
            "extra.ambient_times",
        ):
            np.testing.assert_array_equal(attrgetter(name)(one), attrgetter(name)(two), err_msg=name)


def test_a_capture_comes_back_with_identical_counts_times_levels_and_boards(captured: Path, tmp_path: Path) -> None:
    back = round_trip(captured, tmp_path)
    assert_same(captured, back)
    with Session(back) as session:
        assert session.n_poses == 3
        assert session.has_darks


def test_other_programs_find_the_levels_pattern_and_time_in_the_dng_itself(captured: Path, tmp_path: Path) -> None:
    with Session(captured) as session:
        export_session(session, tmp_path / "pictures")
        camera, counts = session.camera, session.frame(0, 1)
    (tmp_path / "pictures" / "capture.toml").write_text('name = "bare"\n[[poses]]\nfiles = ["pose_0000_*.dng"]\n')
    bare = prepare_import(tmp_path / "pictures", tmp_path / "pictures" / "capture.toml")
    assert bare.arrangement.exposure_times == (0.002, 0.05)
    found = bare.sensor.camera
    assert (found.bayer_pattern, found.bit_depth) == (camera.bayer_pattern, camera.bit_depth)
    assert (found.black_level, found.saturation_value) == (camera.black_level, camera.saturation_value)
    assert (found.make, found.model) == (camera.make, camera.model)
    np.testing.assert_array_equal(read_picture(tmp_path / "pictures" / "pose_0000_1.dng").pixels, counts)


def test_raw_files_with_levels_of_their_own_come_back(tmp_path: Path) -> None:
    for i in range(3):
        write_dng(tmp_path / f"{i}.dng", mosaic(i), (0.01, 0.1, 0.05)[i], b"\2\1\1\0")
    text = """
name = "leaf"
intrinsics = { fx = 100.5, fy = 101, cx = 31.5, cy = 23.5, distortion = [0.1, -0.2] }
camera = { conversion_gain = 2.5, read_noise = 3 }
area = { width_mm = 60, height_mm = 40, pitch_mm = 0.2 }
[[poses]]
files = ["0.dng", "1.dng"]
[[poses]]
files = ["2.dng"]
[[boards]]
kind = "checkerboard"
squares = [10, 7]
square_mm = 25
corner_mm = "measure"
"""
    assert_same(imported(tmp_path, text), round_trip(tmp_path / "s.h5", tmp_path))


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_monochrome_frames_come_back(tmp_path: Path, bits: int) -> None:
    write_png(tmp_path / "a.png", mosaic(0, bits))
    text = 'name = "leaf"\ngrouping = { exposure_times_s = [0.5] }\n'
    if bits == 8:
        write_png(tmp_path / "a.png", mosaic(0, 8).astype(np.uint8))
        text += "linear = true\n"
    assert_same(imported(tmp_path, text), round_trip(tmp_path / "s.h5", tmp_path))


def test_pictures_with_three_channels_and_all_that_is_beside_them_come_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for i, name in enumerate("pabfgh"):
        write_jpeg(tmp_path / f"{name}.jpg", rng.integers(0, 256, (H, W, 3)).astype(np.uint8), (i + 1) / 8)
    text = """
name = "leaf"
linear = false
response = { bracket = { files = ["g.jpg", "h.jpg"] } }
flats = { files = ["f.jpg"], distance_mm = 200 }
[[poses]]
files = ["p.jpg"]
ambient = ["a.jpg"]
[[poses]]
files = ["b.jpg"]
"""
    path = imported(tmp_path, text)
    back = round_trip(path, tmp_path)
    assert_same(path, back)
    with Session(path) as one, Session(back) as two:
        np.testing.assert_array_equal(one.extra.ambient(0), two.extra.ambient(0))
        assert two.extra.ambient(1) is None
        np.testing.assert_array_equal(one.extra.flat_images(0), two.extra.flat_images(0))
        np.testing.assert_array_equal(one.extra.response_images(1), two.extra.response_images(1))


def test_a_response_curve_comes_back(tmp_path: Path) -> None:
    write_jpeg(tmp_path / "a.jpg", np.random.default_rng(0).integers(0, 256, (H, W, 3)).astype(np.uint8), 0.125)
    path = imported(tmp_path, 'name = "leaf"\nlinear = false\nresponse = { gamma = "srgb" }\n')
    assert_same(path, round_trip(path, tmp_path))


def test_floating_point_frames_come_back(tmp_path: Path) -> None:
    for channels in ((), (3,)):
        folder = tmp_path / str(len(channels))
        folder.mkdir()
        pixels = np.random.default_rng(0).uniform(0, 50, (H, W, *channels)).astype(np.float32)
        write_exr(folder / "a.exr", pixels, 0.5)
        assert_same(imported(folder, 'name = "leaf"\n'), round_trip(folder / "s.h5", folder))


def test_only_complete_poses_are_written(captured: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.h5"
    path.write_bytes(captured.read_bytes())
    with h5py.File(path, "r+") as file:
        file[layout.POSE_COMPLETE.path][1] = 0
    with Session(path) as session:
        assert export_session(session, tmp_path / "pictures") == 6
    assert not list((tmp_path / "pictures").glob("pose_0001*"))
    with h5py.File(path, "r+") as file:
        file[layout.POSE_COMPLETE.path][:] = 0
    with Session(path) as session, pytest.raises(InvalidInputError, match="no pose is complete"):
        export_session(session, tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_a_frame_that_cannot_be_decoded_leaves_no_folder(captured: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.h5"
    path.write_bytes(captured.read_bytes())
    with h5py.File(path, "r+") as file:
        file[layout.IMAGES.path].id.write_direct_chunk((1, 0, 0, 0), b"no frame", 0)
    with Session(path) as session, pytest.raises(InvalidInputError, match="cannot be read"):
        export_session(session, tmp_path / "pictures")
    assert [entry.name for entry in tmp_path.iterdir()] == ["s.h5"]


def test_what_is_there_is_kept(captured: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    with Session(captured) as session, pytest.raises(FileExistsError, match="not overwritten"):
        export_session(session, tmp_path / "mine")
    assert not list((tmp_path / "mine").iterdir())
