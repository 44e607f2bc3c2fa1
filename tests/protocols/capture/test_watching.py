"""What whoever watches a capture learns of its poses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import protocols.capture.resumed_session
from instrument.files.validation import InvalidInputError
from instrument.session.preview import Preview
from instrument.session.session import Session
from protocols.capture import run
from protocols.capture.engine import Control, Finish, Progress, capture, resume
from protocols.capture.progress import News, PoseBegun, PoseTaken
from protocols.capture.thumbnails import MAX_WIDTH, thumbnails
from protocols.planning.estimate import estimate
from protocols.planning.planned_poses import PlannedPoses
from protocols.planning.session_rig import planned_poses_of
from protocols.poses.nominal_geometry import lens_and_light
from tests.protocols.fakes import BLACK, HEIGHT, SATURATION, WIDTH, FakeBench, protocol_config, rig_config


def news_of(seen: list[Progress]) -> list[News]:
    return [progress.news for progress in seen if progress.news is not None]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[News]]:
    path, seen = tmp_path_factory.mktemp("watched") / "s.h5", list[Progress]()
    capture(rig_config(), protocol_config(), path, seen.append, FakeBench().devices)
    return path, news_of(seen)


def test_all_poses_are_told_before_the_first_and_each_before_and_after_it(session: tuple[Path, list[News]]) -> None:
    planned, *poses = session[1]
    assert isinstance(planned, PlannedPoses)
    assert planned.complete == frozenset()
    assert [type(news) for news in poses] == [PoseBegun, PoseTaken] * 2
    assert [news.i_pose for news in poses if isinstance(news, PoseBegun | PoseTaken)] == [0, 0, 1, 1]


def test_the_poses_told_are_those_of_the_plan_as_the_rig_file_places_them(session: tuple[Path, list[News]]) -> None:
    planned = session[1][0]
    assert isinstance(planned, PlannedPoses)
    assert planned.positions == ({"tilt": 10.0, "turn": 5.0}, {"tilt": 10.0, "turn": 185.0})
    lens, light = lens_and_light(rig_config(), planned.axes, planned.positions)
    np.testing.assert_array_equal(planned.views.lens, lens)
    np.testing.assert_array_equal(planned.views.light, light)
    assert planned.name(1) == "pose 2 of 2: tilt 10 deg, turn 185 deg"


def test_the_preview_that_is_told_is_the_one_that_the_session_keeps(session: tuple[Path, list[News]]) -> None:
    path, news = session
    taken = [entry for entry in news if isinstance(entry, PoseTaken)]
    with Session(path) as kept:
        for entry in taken:
            np.testing.assert_array_equal(entry.preview.picture, kept.preview(entry.i_pose))
            np.testing.assert_array_equal(entry.clipped, kept.saturated_fraction[entry.i_pose])
            np.testing.assert_array_equal(entry.exposure_times, kept.exposure_times)
            assert entry.preview.picture.max() <= entry.preview.ceiling


def test_a_session_says_the_same_of_its_poses_as_the_rig_did(session: tuple[Path, list[News]]) -> None:
    path, (told, *_) = session
    assert isinstance(told, PlannedPoses)
    with Session(path) as kept:
        read = planned_poses_of(kept)
    assert (read.axes, read.positions) == (told.axes, told.positions)
    assert read.rig.model_dump() == told.rig.model_dump()
    assert (read.height, read.width, read.complete) == (told.height, told.width, {0, 1})
    np.testing.assert_array_equal(read.views.rotation, told.views.rotation)


def interrupted_after(n_poses: int, path: Path) -> None:
    control = Control()

    def watch(progress: Progress) -> None:
        if isinstance(progress.news, PoseTaken) and progress.news.i_pose == n_poses - 1:
            control.pause()

    outcome = capture(rig_config(), protocol_config(count=4), path, watch, FakeBench().devices, control)
    assert (outcome.finish, outcome.n_complete) == (Finish.PAUSED, n_poses)


def test_a_resumed_capture_tells_which_poses_are_complete_and_shows_them(tmp_path: Path) -> None:
    path, seen = tmp_path / "s.h5", list[Progress]()
    interrupted_after(2, path)
    resume(path, seen.append, FakeBench().devices)
    planned, *poses = news_of(seen)
    assert isinstance(planned, PlannedPoses)
    assert planned.complete == planned.previews.keys() == {0, 1}
    with Session(path) as session:
        for i_pose, preview in planned.previews.items():
            np.testing.assert_array_equal(preview.picture, session.preview(i_pose))
    assert [news.i_pose for news in poses if isinstance(news, PoseTaken)] == [2, 3]


def test_damaged_previews_do_not_keep_a_session_from_going_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def damaged(_: Session) -> dict[int, Preview]:
        raise InvalidInputError("damaged", [])

    path, seen = tmp_path / "s.h5", list[Progress]()
    interrupted_after(1, path)
    monkeypatch.setattr(protocols.capture.resumed_session, "previews_of", damaged)
    assert resume(path, seen.append, FakeBench().devices).finish is Finish.COMPLETE
    planned = news_of(seen)[0]
    assert isinstance(planned, PlannedPoses)
    assert (planned.complete, planned.previews) == (frozenset([0]), {})


def test_pictures_that_cannot_be_made_stop_no_capture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object) -> PoseTaken:
        raise ZeroDivisionError

    monkeypatch.setattr(run, "pose_taken", broken)
    outcome = capture(rig_config(), protocol_config(), tmp_path / "s.h5", lambda _: None, FakeBench().devices)
    assert outcome.finish is Finish.COMPLETE
    assert "the capture goes on" in caplog.text


def test_nobody_watches_and_no_picture_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "pose_taken", lambda *_: pytest.fail("a picture was made"))
    assert capture(rig_config(), protocol_config(), tmp_path / "s.h5", devices=FakeBench().devices)


@pytest.mark.parametrize("shape", [(8, 16), (9, 333), (1200, 1920), (3000, 4096)])
def test_a_thumbnail_is_small_and_goes_from_black_to_clipped(shape: tuple[int, int]) -> None:
    counts = np.full((2, *shape), BLACK, np.uint16)
    counts[1] = SATURATION
    small = thumbnails(counts, BLACK, SATURATION)
    assert small.shape[2] <= MAX_WIDTH
    assert small.shape[1] >= 1
    assert (small[0] == 0).all()
    assert (small[1] == 255).all()


def test_an_estimate_hands_over_the_poses_and_no_word_of_them_in_its_dictionary() -> None:
    outlook = estimate(rig_config(), protocol_config(), FakeBench().devices)
    assert outlook.planned is not None
    assert outlook.planned.n_poses == outlook.n_poses == 2
    assert (outlook.planned.height, outlook.planned.width) == (HEIGHT, WIDTH)
    assert "planned" not in outlook.as_dict()
    assert outlook.as_dict() == replace(outlook, planned=None).as_dict()
