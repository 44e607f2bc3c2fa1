from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import h5py
import pytest

from instrument.files.validation import InvalidInputError
from instrument.session import layout
from tests.instrument.conftest import Change
from tests.verifying import verify_session


def problems(path: Path) -> str:
    return "\n".join(map(str, verify_session(path)))


def test_a_sound_session_has_no_problem(session_path: Path) -> None:
    assert problems(session_path) == ""


@pytest.mark.parametrize("i_pose", [0, 1, 2])
@pytest.mark.parametrize("i_exposure", [0, 1])
def test_a_flipped_byte_in_any_frame_is_found_and_named(
    changed: Callable[[Change], Path], i_pose: int, i_exposure: int
) -> None:
    def flip(file: h5py.File) -> None:
        file[layout.IMAGES.path][i_pose, i_exposure, 7, 11] ^= 1

    text = problems(changed(flip))
    assert f"pose {i_pose}, exposure {i_exposure} (" in text
    assert "differs from what was recorded" in text
    assert len(text.splitlines()) == 1


def test_a_byte_flipped_on_the_disk_is_found_in_every_frame(session_path: Path, tmp_path: Path) -> None:
    with h5py.File(session_path) as file:
        images = file[layout.IMAGES.path].id
        chunks = [images.get_chunk_info(i) for i in range(images.get_num_chunks())]
    content = session_path.read_bytes()
    for chunk in chunks:
        damaged = bytearray(content)
        damaged[chunk.byte_offset + chunk.size // 2] ^= 0x10
        (tmp_path / "s.h5").write_bytes(damaged)
        i_pose, i_exposure = chunk.chunk_offset[:2]
        assert f"pose {i_pose}, exposure {i_exposure} (" in problems(tmp_path / "s.h5")


def test_a_frame_that_cannot_be_decoded_does_not_hide_the_next_one(
    changed: Callable[[Change], Path],
) -> None:
    def scramble(file: h5py.File) -> None:
        file[layout.IMAGES.path].id.write_direct_chunk((1, 0, 0, 0), b"no frame", 0)
        file[layout.IMAGES.path][2, 1, 0, 0] ^= 1

    text = problems(changed(scramble))
    assert "pose 1, exposure 0 (0.01 s) cannot be read" in text
    assert "pose 2, exposure 1 (0.1 s) differs" in text


@pytest.mark.parametrize(
    ("field", "at", "value", "expected"),
    [
        (layout.PLAN_JSON, (), "{}", "/entry/plan/sha256: does not fit the plan"),
        (layout.POSE_COMPLETE, 1, 0, "says complete, but 1 of 3 poses are missing"),
        (layout.STATUS, (), "fine", "/entry/status: cannot be read: 'fine' is not a valid Status"),
        (layout.FRAME_DIGEST, (1, 0), b"0" * 64, "pose 1: the digests were changed"),
        (layout.FRAME_OK, 1, 0, "pose 1 is marked complete without a valid frame"),
        (layout.EXPOSURE_READBACK, 2, 0, "pose 2 is marked complete without read-backs"),
        (layout.COUNT_TIME, 0, 0.02, "differs from the plan's [0.01, 0.1] s"),
        (layout.END_TIME, (), "", "is empty in a complete session"),
    ],
)
def test_what_contradicts_itself_is_found(
    changed: Callable[[Change], Path], field: layout.Field, at: object, value: object, expected: str
) -> None:
    def contradict(file: h5py.File) -> None:
        file[field.path][at] = value

    assert expected in problems(changed(contradict))


def test_a_broken_structure_is_reported_and_ends_the_check(changed: Callable[[Change], Path]) -> None:
    def remove(file: h5py.File) -> None:
        del file[layout.TIMESTAMP.path]

    assert problems(changed(remove)) == "/entry/instrument/camera/timestamp: is missing"


def test_what_is_no_session_is_an_error_and_not_a_list(tmp_path: Path) -> None:
    (tmp_path / "s.h5").write_text("hello")
    with pytest.raises(InvalidInputError, match="not an HDF5 file"):
        list(verify_session(tmp_path / "s.h5"))


def test_no_flipped_byte_anywhere_crashes_the_check(session_path: Path, tmp_path: Path) -> None:
    content = session_path.read_bytes()
    for offset in range(0, len(content), len(content) // 30):
        damaged = bytearray(content)
        damaged[offset] ^= 0xFF
        (tmp_path / "s.h5").write_bytes(damaged)
        # Whatever it finds, it finds as problems.
        with suppress(InvalidInputError):
            list(verify_session(tmp_path / "s.h5"))
