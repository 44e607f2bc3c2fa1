from dataclasses import replace

import numpy as np
import pytest

from drivers.camera import Frame
from drivers.errors import DeviceError, UnsafeError
from instrument.rig.rig import Rig
from protocols.acquisition.bracket import Bracket, take_pose
from protocols.acquisition.darks_and_flats import take_darks, take_flats
from tests.protocols.fakes import BLACK, SATURATION, FakeBench, FakeCamera, FakeLight, FakeStage, rig_config

TARGET = {"tilt": 10.0, "turn": 20.0}
BRACKET = Bracket((0.01, 0.1), 0, (BLACK, BLACK))


@pytest.fixture
def bench() -> FakeBench:
    return FakeBench()


@pytest.fixture
def rig(bench: FakeBench) -> Rig:
    return Rig(rig_config(), FakeCamera(bench), FakeLight(bench), FakeStage(bench))


def alter_frames(monkeypatch: pytest.MonkeyPatch, **changes: object) -> None:
    trigger = FakeCamera.trigger
    monkeypatch.setattr(FakeCamera, "trigger", lambda camera: replace(trigger(camera), **changes))


def test_a_pose_keeps_what_the_devices_report(rig: Rig) -> None:
    record = take_pose(rig, TARGET, BRACKET, 2)
    assert record.counts.shape == (2, 16, 24)
    assert record.exposure_readback.tolist() == [0.01, 0.1]
    assert record.positions == TARGET
    assert record.attempts == 2
    assert record.level_set == 0.8


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"counts": np.zeros((16, 23), np.uint16)}, r"uint16 of shape \(16, 23\); expected uint16 of shape"),
        ({"counts": np.zeros((16, 24), np.uint8)}, "delivered uint8"),
        ({"exposure_time": 0.1}, r"frame's exposure time is 0.1 s and should be 0.01 s"),
        ({"exposure_time": float("nan")}, "frame's exposure time is nan"),
        ({"sequence_number": 5}, r"a frame was lost or came twice: the camera numbers them \[5, 5\]"),
    ],
)
def test_a_wrong_frame_is_refused_with_the_light_off(
    rig: Rig, bench: FakeBench, monkeypatch: pytest.MonkeyPatch, changes: dict[str, object], message: str
) -> None:
    alter_frames(monkeypatch, **changes)
    with pytest.raises(DeviceError, match=message):
        take_pose(rig, TARGET, BRACKET, 1)
    assert not bench.lit


def test_a_dark_frame_from_before_in_place_of_a_lit_one_is_found(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    trigger = FakeCamera.trigger

    def stale(camera: FakeCamera) -> Frame:
        frame = trigger(camera)
        # The number and the exposure time are right, as those of a buffer that is used again.
        return replace(frame, counts=np.full((16, 24), 64, np.uint16)) if camera.exposure_time == 0.01 else frame

    monkeypatch.setattr(FakeCamera, "trigger", stale)
    with pytest.raises(DeviceError, match=r"frame of 0.01 s has a mean of 0.0 counts .* where that of 0.1 s tells"):
        take_pose(rig, TARGET, BRACKET, 1)


def test_an_exposure_time_that_did_not_take_is_refused(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeCamera, "set_exposure_time", lambda *_: 0.02)
    with pytest.raises(DeviceError, match=r"camera's exposure time is 0.02 s and should be 0.01 s"):
        take_pose(rig, TARGET, BRACKET, 1)


def test_a_stage_that_stalls_is_never_believed(rig: Rig, bench: FakeBench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeStage, "read", lambda _: {"tilt": 9.9, "turn": 20.0})
    with pytest.raises(DeviceError, match=r"axis 'tilt' reads 9\.9 deg and should be at 10 within 0\.01"):
        take_pose(rig, TARGET, BRACKET, 1)
    assert "light.on" not in bench.calls


def test_a_light_that_stays_dark_is_found(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeLight, "on", lambda light, *_: light.off())
    with pytest.raises(DeviceError, match="told to shine and reports that it is dark"):
        take_pose(rig, TARGET, BRACKET, 1)


def test_a_light_that_goes_dark_during_the_bracket_is_found(
    rig: Rig, bench: FakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FakeLight, "read", lambda light: light.off())
    with pytest.raises(DeviceError, match="went dark during the bracket"):
        take_pose(rig, TARGET, BRACKET, 1)


def test_a_light_that_stays_on_is_found(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeLight, "off", FakeLight.read)
    with pytest.raises(DeviceError, match=r"twice and still shines\. Switch it off by hand"):
        take_pose(rig, TARGET, BRACKET, 1)
    with pytest.raises(DeviceError, match="twice and still shines"):
        take_darks(rig, 0.01, 2)


def test_darks_have_the_mean_and_variance_of_numpy(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = np.random.default_rng(0).integers(0, 400, (5, 16, 24)).astype(np.uint16)
    queue = enumerate(frames)
    monkeypatch.setattr(FakeCamera, "trigger", lambda _: _numbered(next(queue)))
    mean, variance, _, _ = take_darks(rig, 0.01, 5)
    np.testing.assert_allclose(mean, frames.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(variance, frames.var(axis=0, ddof=1), rtol=1e-6)


def test_a_frame_that_is_missing_among_the_darks_is_found(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = iter([4, 5, 7])
    monkeypatch.setattr(FakeCamera, "trigger", lambda _: _numbered((next(numbers), np.full((16, 24), 64, np.uint16))))
    with pytest.raises(DeviceError, match=r"a frame was lost or came twice: the camera numbers them \[4, 5, 7\]"):
        take_darks(rig, 0.01, 3)


def test_flats_that_clip_and_darks_that_are_bright_are_refused(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    alter_frames(monkeypatch, counts=np.full((16, 24), int(SATURATION), np.uint16))
    with pytest.raises(UnsafeError, match=r"flat frames of 0.01 s clip. Choose a shorter flats.exposure_time_s"):
        take_flats(rig, 0.01, 2)
    with pytest.raises(UnsafeError, match=r"darks of 0.01 s are not dark: 4031 counts above the black level"):
        take_darks(rig, 0.01, 2)


def _numbered(frame: tuple[int, np.ndarray]) -> Frame:
    number, counts = frame
    return Frame(counts, number, 0.01, 30.0)
