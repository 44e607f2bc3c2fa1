"""A session without a rig: what an import writes, by way of the same header and recorder."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import silx.io
from silx.io.nxdata import NXdata, get_default

from analysis.calibration.nominal import nominal_setup
from instrument.files.digests import text_digest
from instrument.files.validation import InvalidInputError
from instrument.recording.creation import create_session
from instrument.recording.header import Provenance, SessionHeader
from instrument.recording.recorder import Recorder
from instrument.session import layout
from instrument.session.import_plan import ImportPlan, Source
from instrument.session.layout import Status
from instrument.session.records import Board, CameraRecord, Geometry, PoseRecord
from instrument.session.session import Session
from protocols.capture.engine import Finish, resume
from tests.verifying import verify_session

H, W = 16, 24
CAMERA = CameraRecord("acme", "pocket", "", H, W, 3, "f4", 32, 0.0, np.inf, "", np.nan, np.nan)
CHECKERBOARD = Board("checkerboard", "", 0, (10, 7), 25.0, 0.0, (np.nan, np.nan))
PLAN = ImportPlan((0.01, 0.1), ((Source("a.exr", "0" * 64, 0.01),), (Source("b.exr", "1" * 64, 0.1),)))


def header(plan: ImportPlan = PLAN, camera: CameraRecord = CAMERA) -> SessionHeader:
    return SessionHeader(
        title="holiday",
        sample="leaf",
        description="holiday: leaf",
        plan_json=plan.json,
        plan_sha256=plan.sha256,
        n_poses=2,
        exposure_times=(0.01, 0.1),
        camera=camera,
        geometry=Geometry(),
        boards=(CHECKERBOARD,),
        provenance=Provenance('name = "holiday"\n'),
        optional={layout.AMBIENT_TIME: [0.5], layout.AMBIENT_OF_POSE: [-1, 0], layout.DISTORTION: [0.1, 0, 0, 0, 0]},
        empty={layout.AMBIENT_IMAGES: (1, *camera.frame_shape)},
    )


def picture(i: int, camera: CameraRecord = CAMERA) -> np.ndarray:
    return np.random.default_rng(i).uniform(0, 100, camera.frame_shape).astype(camera.dtype)


def record(i_exposure: int, frame: np.ndarray) -> PoseRecord:
    unknown, time = np.full(1, np.nan), np.array([(0.01, 0.1)[i_exposure]])
    index, never = np.array([i_exposure]), np.zeros(1, np.int64)
    return PoseRecord(index, frame[None], time, unknown, never, np.nan, unknown, unknown, unknown, {}, 1)


def write(path: Path, camera: CameraRecord = CAMERA) -> Path:
    create_session(path, header(camera=camera), 0)
    with Recorder(path) as recorder:
        recorder.write_pose(0, record(0, picture(0, camera)))
        recorder.write_pose(1, record(1, picture(1, camera)))
        recorder.write_beside(layout.AMBIENT_IMAGES, 0, picture(2, camera))
        recorder.close(Status.COMPLETE)
    return path


@pytest.fixture
def imported(tmp_path: Path) -> Path:
    return write(tmp_path / "imported.h5")


@pytest.fixture
def changed(imported: Path) -> Callable[[Callable[[h5py.File], object]], Path]:
    def change(how: Callable[[h5py.File], object]) -> Path:
        with h5py.File(imported, "r+") as file:
            how(file)
        return imported

    return change


@pytest.mark.parametrize("dtype", ["f4", "u2"])
@pytest.mark.parametrize("n_channels", [1, 3])
def test_frames_of_every_kind_read_back(tmp_path: Path, dtype: str, n_channels: int) -> None:
    camera = replace(CAMERA, dtype=dtype, n_channels=n_channels)
    path = write(tmp_path / "s.h5", camera)
    assert list(verify_session(path)) == []
    with Session(path) as session:
        assert (session.camera.dtype, session.camera.n_channels) == (dtype, n_channels)
        np.testing.assert_array_equal(session.frame(0, 0), picture(0, camera))
        np.testing.assert_array_equal(session.frames(1)[1], picture(1, camera))
        np.testing.assert_array_equal(session.extra.ambient(1), picture(2, camera))


def test_a_pose_without_an_exposure_says_so(imported: Path) -> None:
    with Session(imported) as session:
        assert session.frame_ok.tolist() == [[True, False], [False, True]]
        assert session.frame_digests[0][1] == ""
        np.testing.assert_array_equal(session.exposure_readback, [[0.01, np.nan], [np.nan, 0.1]])
        assert np.isnan(session.timestamps).all()
        assert session.extra.ambient(0) is None
        np.testing.assert_array_equal(session.extra.ambient_times, [np.nan, 0.5])


def test_what_nobody_stated_is_none(imported: Path) -> None:
    with Session(imported) as session:
        assert session.nominal.area_mm is session.nominal.focal_length_px is session.nominal.working_distance_mm is None
        assert session.nominal.light_offset_mm is session.nominal.light_offset_sigma_mm is None
        assert session.nominal.camera_matrix is session.nominal.black_level_cell is session.nominal.response is None
        assert session.nominal.distortion is not None
        assert len(session.extra.flat_times) == len(session.extra.response_times) == 0
        assert (session.rig_text, session.rig_json) == ("", "")
        assert session.protocol_text == 'name = "holiday"\n'
        (board,) = session.nominal.boards
        assert not board.is_placed
        assert replace(board, corner_mm=(0, 0)) == replace(CHECKERBOARD, corner_mm=(0, 0))


def test_an_import_is_complete_and_cannot_be_resumed(imported: Path) -> None:
    assert resume(imported).finish is Finish.COMPLETE
    with h5py.File(imported, "r+") as file:
        file[layout.POSE_COMPLETE.path][1] = 0
    with pytest.raises(InvalidInputError, match="import the pictures again"):
        resume(imported)


def test_frames_that_are_not_those_of_the_plan_are_found(changed: Callable[..., Path]) -> None:
    def move(file: h5py.File) -> None:
        file[layout.EXPOSURE_READBACK.path][1, 1] = 0.2

    (problem,) = verify_session(changed(move))
    assert "pose 1 is not b.exr of [0.1] s, as the plan says" in problem.what


def test_a_plan_that_lost_its_pictures_is_none(changed: Callable[..., Path]) -> None:
    def ruin(file: h5py.File) -> None:
        text = '{"kind":"import","exposure_times_s":[0.01,0.1],"poses":[[{"file":"a.exr"}],[]]}'
        file[layout.PLAN_JSON.path][()] = text
        file[layout.PLAN_SHA256.path][()] = text_digest(text)

    (problem,) = verify_session(changed(ruin))
    assert problem.what == "is not a plan"


def test_an_index_that_leads_nowhere_is_a_problem(changed: Callable[..., Path]) -> None:
    def mislead(file: h5py.File) -> None:
        file[layout.AMBIENT_OF_POSE.path][1] = 7

    with Session(changed(mislead)) as session:
        with pytest.raises(InvalidInputError, match="ambient"):
            _ = session.extra.ambient_times
        with pytest.raises(InvalidInputError, match="ambient"):
            session.extra.ambient(1)


def test_channels_that_differ_from_those_of_the_frames_are_refused(changed: Callable[..., Path]) -> None:
    def flatten(file: h5py.File) -> None:
        del file[layout.AMBIENT_IMAGES.path]
        file.create_dataset(layout.AMBIENT_IMAGES.path, (1, H, W), "f4").attrs["units"] = "counts"

    with pytest.raises(InvalidInputError, match=r"ambient_images: has shape \(1, 16, 24\)"):
        Session(changed(flatten))


def test_calibration_says_all_that_must_be_stated(imported: Path) -> None:
    with Session(imported) as session, pytest.raises(InvalidInputError) as caught:
        nominal_setup(session)
    text = str(caught.value)
    for fragment in (
        "area_mm: is not stated",
        "state [light] offset_mm in capture.toml",
        "light_offset_sigma_mm: is not",
    ):
        assert fragment in text


def test_silx_opens_pictures_with_channels(imported: Path) -> None:
    with silx.io.open(str(imported)) as file:
        plot = get_default(file)
        assert plot is not None
        assert plot.is_valid
        raw = NXdata(file[layout.RAW])
        assert raw.is_valid
        assert raw.interpretation == "rgba-image"
