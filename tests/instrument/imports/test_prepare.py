"""From a folder of pictures and its `capture.toml` to a session."""

import json
import weakref
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from instrument.files.validation import InvalidInputError
from instrument.imports import survey, writing
from instrument.imports.prepare import prepare_import
from instrument.imports.writing import write_import
from instrument.pictures.picture import Picture
from instrument.pictures.reading import read_picture
from instrument.session.import_plan import ImportPlan
from instrument.session.layout import Status
from instrument.session.session import Session
from tests.instrument.imports.folders import (
    TIMES,
    H,
    W,
    imported,
    mosaic,
    refused,
    write_capture,
    write_dng,
    write_exr,
    write_jpeg,
    write_png,
    write_tiff,
)


def test_a_folder_of_brackets_becomes_a_session(brackets: Path) -> None:
    with imported(brackets, 'name = "leaf"\nsample = "oak"\n[grouping]\nby = "exposure"\n') as session:
        assert (session.title, session.sample, session.status) == ("leaf", "oak", Status.COMPLETE)
        assert session.is_imported
        assert session.exposure_times.tolist() == list(TIMES)
        np.testing.assert_allclose(session.exposure_readback, [TIMES] * 3)
        for i_pose in range(3):
            for i_exposure in range(2):
                np.testing.assert_array_equal(session.frame(i_pose, i_exposure), mosaic(2 * i_pose + i_exposure))
        camera = session.camera
        assert (camera.make, camera.model, camera.bayer_pattern, camera.bit_depth) == ("acme", "pocket", "RGGB", 12)
        assert (camera.black_level, camera.saturation_value) == (65.5, 4095)
        np.testing.assert_array_equal(session.nominal.black_level_cell, [[64, 65], [66, 67]])
        assert np.isnan([camera.conversion_gain, camera.read_noise]).all()


def test_the_plan_names_every_picture_with_its_digest(brackets: Path) -> None:
    with imported(brackets, 'name = "leaf"\n[grouping]\nframes_per_pose = 2\n') as session:
        plan = ImportPlan.from_dict(json.loads(session.plan_json))
    assert plan.json == session_plan(brackets)
    names = [[source.file for source in pose] for pose in plan.poses]
    assert names == [["IMG_8.dng", "IMG_9.dng"], ["IMG_10.dng", "IMG_11.dng"], ["IMG_12.dng", "IMG_13.dng"]]
    for source in (source for pose in plan.poses for source in pose):
        assert source.sha256 == sha256((brackets / source.file).read_bytes()).hexdigest()


def session_plan(folder: Path) -> str:
    with Session(folder / "s.h5") as session:
        return session.plan_json


def test_without_grouping_every_picture_is_a_pose(brackets: Path) -> None:
    with imported(brackets) as session:
        assert session.n_poses == 6
        assert session.frame_ok.tolist() == [[True, False], [False, True]] * 3
        np.testing.assert_array_equal(session.frame(3, 1), mosaic(3))


def test_poses_may_have_brackets_of_their_own_and_pictures_in_any_order(brackets: Path) -> None:
    text = """
name = "leaf"
[[poses]]
files = ["IMG_9.dng", "IMG_8.dng"]
[[poses]]
files = ["IMG_10.dng"]
exposure_times_s = [0.04]
[[poses]]
files = ["IMG_1[12].dng", "IMG_13.dng"]
exposure_times_s = [1.0, 2.0, 4.0]
"""
    with imported(brackets, text) as session:
        assert session.exposure_times.tolist() == [0.01, 0.04, 0.1, 1.0, 2.0, 4.0]
        assert session.frame_ok.sum(axis=1).tolist() == [2, 1, 3]
        np.testing.assert_array_equal(session.frame(0, 0), mosaic(0))
        np.testing.assert_array_equal(session.frame(0, 2), mosaic(1))
        np.testing.assert_array_equal(session.frame(2, 5), mosaic(5))


@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("write", [write_png, lambda path, pixels: write_tiff(path, pixels, None)])
def test_left_and_right_aligned_containers_give_identical_sessions(
    tmp_path: Path, bits: int, write: Callable[[Path, np.ndarray], Path]
) -> None:
    counts = mosaic(0, bits)
    found = []
    for name, pixels in (("right", counts), ("left", counts << np.uint16(16 - bits))):
        (tmp_path / name).mkdir()
        write(tmp_path / name / f"a.{'png' if write is write_png else 'tif'}", pixels)
        with imported(tmp_path / name, 'name = "leaf"\n[grouping]\nexposure_times_s = [0.5]\n') as session:
            np.testing.assert_array_equal(session.frame(0, 0), counts)
            found.append((session.camera, session.frame_digests))
            assert session.camera.bit_depth == bits
            assert session.camera.saturation_value == 2**bits - 1
    assert str(found[0]) == str(found[1])


def test_levels_of_a_left_aligned_raw_file_are_shifted_with_its_counts(tmp_path: Path) -> None:
    levels = {"black": tuple(16 * b for b in (64, 65, 66, 67)), "white": 4095 * 16}
    write_dng(tmp_path / "a.dng", mosaic(0) << np.uint16(4), 0.1, **levels)
    with imported(tmp_path) as session:
        np.testing.assert_array_equal(session.frame(0, 0), mosaic(0))
        np.testing.assert_array_equal(session.nominal.black_level_cell, [[64, 65], [66, 67]])
        assert (session.camera.saturation_value, session.camera.bit_depth) == (4095, 12)


def test_what_is_stated_comes_before_what_files_say(brackets: Path) -> None:
    text = """
name = "leaf"
[camera]
make = "own"
black_level = 32
saturation_level = 4000
conversion_gain = 2.5
read_noise = 3
bayer_pattern = "GRBG"
"""
    with imported(brackets, text) as session:
        camera = session.camera
        assert (camera.make, camera.model, camera.bayer_pattern) == ("own", "pocket", "GRBG")
        assert (camera.black_level, camera.saturation_value) == (32, 4000)
        assert (camera.conversion_gain, camera.read_noise) == (2.5, 3)
        assert session.nominal.black_level_cell is None


def test_floating_point_pictures_stay_what_they_are(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).uniform(0, 50, (H, W, 3)).astype(np.float32)
    write_exr(tmp_path / "a.exr", pixels, 0.5)
    with imported(tmp_path) as session:
        np.testing.assert_array_equal(session.frame(0, 0), pixels)
        assert (session.camera.dtype, session.camera.n_channels, session.camera.black_level) == ("f4", 3, 0)
        assert np.isinf(session.camera.saturation_value)
        assert (session.saturated_fraction == 0).all()


def test_everything_beside_the_poses_is_imported(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    pictures = {name: rng.integers(0, 256, (H, W, 3)).astype(np.uint8) for name in "pqabfghr"}
    for i, (name, pixels) in enumerate(pictures.items()):
        write_jpeg(tmp_path / f"{name}.jpg", pixels, 0.1 * (i + 1))
    (tmp_path / "curve.csv").write_text("count,linear\n0,0\n255,1\n")
    text = """
name = "leaf"
linear = false
working_distance_mm = 200
response = { bracket = { files = ["g.jpg", "h.jpg", "r.jpg"], times_s = [1.0, 2.0, 4.0] } }
intrinsics = { fx = 100, fy = 101, cx = 31.5, cy = 23.5, distortion = [0.1, -0.2] }
light = { offset_mm = [11, 0, 0], offset_sigma_mm = 2 }
area = { width_mm = 60, height_mm = 40, pitch_mm = 0.2 }
ambient = { files = ["a.jpg"] }
flats = { files = ["f.jpg"], distance_mm = 200 }
[[poses]]
files = ["p.jpg"]
ambient = ["b.jpg"]
[[poses]]
files = ["q.jpg"]
[[boards]]
kind = "checkerboard"
squares = [10, 7]
square_mm = 25
corner_mm = "measure"
"""
    with imported(tmp_path, text) as session:
        assert session.nominal.response is None
        assert session.extra.response_times.tolist() == [1, 2, 4]
        np.testing.assert_array_equal(session.extra.response_images(2), read_picture(tmp_path / "r.jpg").pixels)
        np.testing.assert_allclose(session.extra.ambient_times, [0.4, 0.3])
        assert (session.extra.ambient(0) != session.extra.ambient(1)).any()
        assert session.extra.flat_distances_mm.tolist() == [200]
        assert session.extra.flat_images(0).shape == (H, W, 3)
        np.testing.assert_array_equal(session.nominal.camera_matrix, [[100, 0, 31.5], [0, 101, 23.5], [0, 0, 1]])
        np.testing.assert_array_equal(session.nominal.distortion, [0.1, -0.2, 0, 0, 0])
        assert (session.nominal.focal_length_px, session.nominal.working_distance_mm) == (100.5, 200)
        assert (session.nominal.area_mm, session.nominal.pixel_pitch_mm) == ((60, 40), 0.2)
        assert session.nominal.light_offset_mm is not None
        assert session.nominal.light_offset_sigma_mm is not None
        assert (session.nominal.light_offset_mm.tolist(), session.nominal.light_offset_sigma_mm.tolist()) == (
            [11, 0, 0],
            [2, 2, 2],
        )
        assert not session.nominal.boards[0].is_placed


def test_darks_become_mean_and_variance_for_each_exposure(brackets: Path) -> None:
    rng = np.random.default_rng(5)
    (brackets / "darks").mkdir()
    darks = {time: [rng.integers(60, 70, (H, W)).astype(np.uint16) for _ in range(3)] for time in TIMES}
    for time, frames in darks.items():
        for i, frame in enumerate(frames):
            write_dng(brackets / "darks" / f"{time}_{i}.dng", frame, time)
    text = 'name = "leaf"\ndarks = { files = ["darks/*.dng"] }\ngrouping = { by = "exposure" }\n'
    with imported(brackets, text) as session:
        expected = np.stack([np.stack(frames) for frames in darks.values()]).astype(float)
        assert session.has_darks
        np.testing.assert_allclose(session.dark, expected.mean(axis=1), rtol=1e-6)
        np.testing.assert_allclose(session.dark_variance, expected.var(axis=1, ddof=1), rtol=1e-5, atol=1e-6)


def test_one_dark_frame_has_no_variance(brackets: Path) -> None:
    for time in TIMES:
        write_tiff(brackets / f"dark_{time}.tif", np.full((H, W), 64.25, np.float32), time)
    text = 'name = "leaf"\ndarks = { files = ["dark*.tif"] }\ngrouping = { glob = "*.dng", by = "exposure" }\n'
    with imported(brackets, text) as session:
        np.testing.assert_array_equal(session.dark, np.full((2, H, W), 64.25, np.float32))
        assert np.isnan(session.dark_variance).all()


def test_a_given_curve_is_stored(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", np.random.default_rng(0).integers(0, 256, (H, W)).astype(np.uint8))
    text = 'name = "leaf"\nlinear = false\nresponse = { gamma = 2.0 }\ngrouping = { exposure_times_s = [1.0] }\n'
    with imported(tmp_path, text) as session:
        np.testing.assert_allclose(session.nominal.response, np.linspace(0, 1, 256)[None] ** 2, rtol=1e-6)


def test_a_file_that_fails_half_way_leaves_nothing(brackets: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prepared = prepare_import(brackets, write_capture(brackets, 'name = "leaf"\n'))
    before = sorted(brackets.iterdir())
    (brackets / "IMG_12.dng").write_bytes(b"no longer a picture")
    with pytest.raises(InvalidInputError, match=r"IMG_12.dng: cannot be read"):
        write_import(prepared, brackets / "s.h5")
    assert sorted(brackets.iterdir()) == before

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(writing.Recorder, "write_pose", full)
    with pytest.raises(OSError, match=r"s\.h5 is not written: disk full; it needs"):
        write_import(prepared, brackets / "s.h5")
    assert sorted(brackets.iterdir()) == before


def test_an_existing_file_is_kept(brackets: Path) -> None:
    prepared = prepare_import(brackets, write_capture(brackets, 'name = "leaf"\n'))
    (brackets / "s.h5").write_text("precious")
    with pytest.raises(FileExistsError, match="not overwritten"):
        write_import(prepared, brackets / "s.h5")
    assert (brackets / "s.h5").read_text() == "precious"


def test_a_picture_that_changed_since_it_was_looked_at_is_refused(brackets: Path) -> None:
    prepared = prepare_import(brackets, write_capture(brackets, 'name = "leaf"\n'))
    write_dng(brackets / "IMG_12.dng", mosaic(9)[: H // 2].repeat(3, axis=0), 0.1)
    with pytest.raises(InvalidInputError, match="was changed while it was imported"):
        write_import(prepared, brackets / "s.h5")


def test_black_levels_that_differ_are_noted_and_their_medians_used(tmp_path: Path) -> None:
    for i in range(3):
        write_dng(tmp_path / f"{i}.dng", mosaic(i), 0.1, black=(64 + i, 65, 66, 67))
    prepared = prepare_import(tmp_path, write_capture(tmp_path, 'name = "leaf"\n'))
    assert prepared.sensor.black_level == (65, 65, 66, 67)
    assert prepared.sensor.notes == ("the pictures state black levels from 64 to 67; the medians are used",)


def test_more_exposure_times_than_a_session_can_have_are_refused(tmp_path: Path) -> None:
    for i in range(257):
        write_png(tmp_path / f"{i}.png", mosaic(0))
    times = ", ".join(str(float(1.05**i)) for i in range(257))
    text = f'name = "leaf"\n[[poses]]\nfiles = ["*.png"]\nexposure_times_s = [{times}]\n'
    assert "there are 257 of all pictures together; allowed are 256" in refused(tmp_path, text)


def test_only_one_picture_is_in_memory_while_folders_are_looked_at(
    brackets: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held: list[weakref.ref[np.ndarray]] = []
    most = []

    def counted(path: Path) -> Picture:
        picture = read_picture(path)
        held.append(weakref.ref(picture.pixels))
        most.append(sum(ref() is not None for ref in held))
        return picture

    monkeypatch.setattr(survey, "read_picture", counted)
    monkeypatch.setattr(writing, "read_picture", counted)
    imported(brackets, 'name = "leaf"\n[grouping]\nby = "exposure"\n').close()
    # A bracket, and the last frame of the one before.
    assert max(most) <= 3
