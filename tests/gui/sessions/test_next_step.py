"""The command lines that process a session again, and from what."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import pytest

from analysis.registration.stack_file import write_stack
from gui.sessions.next_step import calibrating, reconstructing, reporting
from instrument.files.validation import InvalidInputError
from instrument.session import layout
from instrument.session.session import Session
from protocols.capture.engine import capture
from tests.protocols.fakes import FakeBench, protocol_config, rig_config
from tests.synthetic import make_stack


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("session") / "a.h5"
    capture(rig_config(), protocol_config(count=3), path, devices=FakeBench().devices)
    return path


@pytest.fixture
def session(whole: Path, tmp_path: Path) -> Path:
    (tmp_path / "a.h5").hardlink_to(whole)
    return tmp_path / "a.h5"


def put_stack(path: Path, digest: str) -> Path:
    write_stack(path, replace(make_stack(n_views=4, size=4), notes={"session_digest": digest}))
    return path


def test_a_calibration_registers_the_session_too_if_it_shows_boards(session: Path, tmp_path: Path):
    step = calibrating(session)
    assert step.arguments[:4] == ("calibrate", str(session), "-o", str(session.with_name("a.stack.h5")))
    assert step.made == session.with_name("a.calibration.json")
    step.made.touch()
    assert calibrating(session).made == session.with_name("a-2.calibration.json")
    shutil.copy(session, tmp_path / "bare.h5")
    with h5py.File(tmp_path / "bare.h5", "r+") as file:
        del file[layout.board_group(0)]
    assert "-o" not in calibrating(tmp_path / "bare.h5").arguments


def test_a_reconstruction_starts_at_the_stack_of_the_very_frames(session: Path):
    (_, source, _, made) = reconstructing(session).arguments
    assert (source, made) == (str(session), str(session.with_name("a.result.h5")))
    with Session(session) as opened:
        stack = put_stack(session.with_name("a-2.stack.h5"), opened.digest())
    put_stack(session.with_name("a.stack.h5"), "of other frames")
    session.with_name("a-3.stack.h5").write_bytes(b"damaged")
    assert reconstructing(session).arguments[1] == str(stack)


def test_a_stack_in_the_list_is_reconstructed_itself(tmp_path: Path):
    step = reconstructing(tmp_path / "b.stack.h5")
    assert step.arguments == ("reconstruct", str(tmp_path / "b.stack.h5"), "-o", str(tmp_path / "b.result.h5"))


def test_the_report_is_of_a_result_or_there_is_none(session: Path):
    with pytest.raises(InvalidInputError, match="reconstruct it"):
        reporting(session)
    result = session.with_name("a.result.h5")
    result.touch()
    page = str(session.with_name("a.html"))
    assert reporting(session).arguments == reporting(result).arguments == ("report", str(result), "-o", page)


def test_what_is_no_session_is_not_begun_with(tmp_path: Path):
    (tmp_path / "a.h5").write_bytes(b"nothing")
    for step in (calibrating, reconstructing):
        with pytest.raises(InvalidInputError):
            step(tmp_path / "a.h5")
