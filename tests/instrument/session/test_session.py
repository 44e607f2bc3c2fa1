from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from instrument.files.validation import InvalidInputError
from instrument.session import layout
from instrument.session.layout import Status
from instrument.session.records import Board
from instrument.session.session import Session
from protocols.planning.plan import Plan
from tests.instrument.conftest import Change
from tests.protocols.fakes import HEIGHT, WIDTH, protocol_config, rig_config


def refusal(path: Path) -> str:
    with pytest.raises(InvalidInputError) as caught:
        Session(path)
    return str(caught.value)


def test_what_was_recorded_reads_back(session_path: Path) -> None:
    with Session(session_path) as session:
        assert (session.title, session.sample, session.status) == ("two views", "coin", Status.COMPLETE)
        assert session.n_poses == 3
        assert session.exposure_times.tolist() == [0.01, 0.1]
        assert session.pose_complete.tolist() == [True] * 3
        assert session.frame_ok.all()
        assert session.exposure_readback.tolist() == [[0.01, 0.1]] * 3
        np.testing.assert_allclose(session.axis_values["tilt"], 10.0)
        np.testing.assert_allclose(session.axis_values["turn"], [5.0, 125.0, 245.0])
        assert (np.diff(session.timestamps.ravel()) > 0).all()
        assert session.start_time < session.end_time


def test_frames_darks_and_camera_read_back(session_path: Path) -> None:
    with Session(session_path) as session:
        frames = session.frames(2)
        assert frames.shape == (2, HEIGHT, WIDTH)
        assert frames.dtype == np.uint16
        np.testing.assert_array_equal(frames[1], session.frame(2, 1))
        assert session.dark is not None
        assert session.dark_variance is not None
        assert session.dark.shape == session.dark_variance.shape == (2, HEIGHT, WIDTH)
        assert (session.dark == 64).all()
        camera = session.camera
        assert (camera.height, camera.width, camera.bit_depth) == (HEIGHT, WIDTH, 12)
        assert (camera.black_level, camera.saturation_value, camera.bayer_pattern) == (64, 4095, "RGGB")
        assert (camera.conversion_gain, camera.read_noise, camera.serial_number) == (2, 3, "one")


def test_calibration_and_provenance_read_back(session_path: Path) -> None:
    plan = Plan.from_protocol(protocol_config(count=3))
    with Session(session_path) as session:
        assert session.nominal.boards == (Board("charuco", "DICT_4X4_50", 8, (4, 3), 5.5, 4.4, (32.0, 54.0)),)
        assert session.nominal.light_offset_mm.tolist() == [12, 1, 0.5]
        assert session.nominal.light_offset_sigma_mm.tolist() == [3, 3, 3]
        assert session.nominal.area_mm == (60, 40)
        assert (session.nominal.working_distance_mm, session.nominal.focal_length_px) == (350, 50)
        assert (session.plan_json, session.plan_sha256) == (plan.json, plan.sha256)
        assert session.rig_text == rig_config().text
        assert session.protocol_text == protocol_config(count=3).text


def test_the_digest_follows_the_frames_and_the_plan_only(session_path: Path, changed: Callable[[Change], Path]) -> None:
    def edit(file: h5py.File) -> None:
        file[layout.TITLE.path][()] = "another title"

    with Session(session_path) as one, Session(changed(edit)) as two:
        assert one.digest() == two.digest()


def test_the_digest_leaves_out_poses_that_are_not_complete(
    session_path: Path, changed: Callable[[Change], Path]
) -> None:
    def undo(file: h5py.File) -> None:
        file[layout.POSE_COMPLETE.path][1] = 0

    with Session(session_path) as one, Session(changed(undo)) as two:
        assert one.digest() != two.digest()


def test_a_pose_that_does_not_exist_is_an_index_error(session_path: Path) -> None:
    with Session(session_path) as session, pytest.raises(IndexError, match="allowed is 0 to 2"):
        session.frames(3)


def test_saturation_is_counted_per_frame(session_path: Path) -> None:
    with Session(session_path) as session:
        expected = [(session.frames(i) >= 4095).mean(axis=(1, 2)) for i in range(3)]
        np.testing.assert_allclose(session.saturated_fraction, expected)


def test_files_that_are_no_sessions_are_refused_with_the_reason(tmp_path: Path) -> None:
    assert "there is no such file" in refusal(tmp_path / "none.h5")
    assert "this is a folder" in refusal(tmp_path)
    (tmp_path / "text.h5").write_text("hello")
    assert "this is not an HDF5 file" in refusal(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["data"] = 1
    assert "/entry has no halfangle_schema" in refusal(tmp_path / "other.h5")
    with h5py.File(tmp_path / "stack.h5", "w") as file:
        file.create_group("entry/stack")
        file["entry"].attrs["halfangle_schema"] = "1.0"
    assert "this is not a session: /entry holds stack" in refusal(tmp_path / "stack.h5")


def test_a_session_of_a_later_format_is_refused(changed: Callable[[Change], Path]) -> None:
    path = changed(lambda file: file["entry"].attrs.modify("halfangle_schema", "2.0"))
    assert "format 2.0; this halfangle reads 1.x" in refusal(path)


def test_a_session_of_format_1_0_is_read(changed: Callable[[Change], Path]) -> None:
    def age(file: h5py.File) -> None:
        file["entry"].attrs.modify("halfangle_schema", "1.0")

    with Session(changed(age)) as session:
        assert session.nominal.area_mm == (60, 40)
        assert session.frames(0).shape == (2, HEIGHT, WIDTH)
        assert not session.is_imported


@pytest.mark.parametrize("share", [0.02, 0.5, 0.99])
def test_a_file_that_is_cut_short_is_refused(session_path: Path, tmp_path: Path, share: float) -> None:
    content = session_path.read_bytes()
    (tmp_path / "cut.h5").write_bytes(content[: int(share * len(content))])
    assert "the file is damaged or cut short" in refusal(tmp_path / "cut.h5")


def replaced(field: layout.Field, **options: object) -> Change:
    def change(file: h5py.File) -> None:
        del file[field.path]
        file.create_dataset(field.path, **options)

    return change


def test_everything_missing_or_mis_shaped_is_named_at_once(changed: Callable[[Change], Path]) -> None:
    def ruin(file: h5py.File) -> None:
        del file[layout.STATUS.path]
        del file[layout.JOURNAL]
        del file[layout.axis_field("tilt", "value").path]
        file[layout.COUNT_TIME.path].attrs["units"] = "ms"
        replaced(layout.FRAME_OK, shape=(3, 5), dtype="u1")(file)
        replaced(layout.BLACK_LEVEL, data="dark")(file)
        replaced(layout.PLAN_JSON, data=3)(file)

    text = refusal(changed(ruin))
    for fragment in (
        "/entry/status: is missing",
        "/entry/journal/pose_complete: /entry/journal is missing",
        "/entry/instrument/stage/tilt/value: is missing",
        "count_time: has units 'ms'; expected 's'",
        "frame_ok: has shape (3, 5); expected (P=3, E=2)",
        "black_level: has type object; expected f8",
        "plan/json: has type int64; expected str",
    ):
        assert fragment in text


def test_links_and_virtual_data_that_lead_out_of_the_file_are_refused(
    changed: Callable[[Change], Path], session_path: Path
) -> None:
    def lead_out(file: h5py.File) -> None:
        source = h5py.VirtualSource(session_path, layout.IMAGES.path, (3, 2, HEIGHT, WIDTH), "u2")
        virtual = h5py.VirtualLayout((3, 2, HEIGHT, WIDTH), "u2")
        virtual[...] = source
        del file[layout.IMAGES.path]
        file.create_virtual_dataset(layout.IMAGES.path, virtual)
        for field in (layout.TITLE, layout.DARK):
            del file[field.path]
        file[layout.TITLE.path] = h5py.ExternalLink(str(session_path), layout.TITLE.path)
        file[layout.DARK.path] = h5py.SoftLink("/entry/elsewhere")
        file["entry/extra"] = h5py.ExternalLink(str(session_path), "/")

    text = refusal(changed(lead_out))
    assert "/entry/instrument/camera/images: takes its values from other files" in text
    assert "/entry/title: is a link to elsewhere" in text
    assert "/entry/extra: links to another file" in text


def test_sizes_that_no_session_has_are_refused_before_memory_is_taken(
    changed: Callable[[Change], Path],
) -> None:
    path = changed(replaced(layout.IMAGES, shape=(3, 2, 2**20, 2**20), dtype="u2", chunks=(1, 1, 16, 16)))
    text = refusal(path)
    assert "has H = 1048576; allowed is 1 to 65536" in text
    assert "needs 4398046511104 bytes for one pose" in text


def test_a_frame_that_cannot_be_decoded_is_a_problem_and_no_crash(
    changed: Callable[[Change], Path],
) -> None:
    def scramble(file: h5py.File) -> None:
        file[layout.IMAGES.path].id.write_direct_chunk((1, 0, 0, 0), b"no frame", 0)

    with Session(changed(scramble)) as session, pytest.raises(InvalidInputError, match="cannot be read"):
        session.frames(1)
