"""The GenICam driver against Aravis' own camera, over the network."""

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from threading import Event

import pytest

from drivers.driver import DeviceState
from drivers.errors import DeviceError, DeviceLimitError, DeviceLostError, DeviceTimeoutError
from drivers.genicam import camera as camera_module
from drivers.genicam import discovery, finding
from drivers.genicam.aravis import listed_cameras
from drivers.genicam.camera import GenicamCamera
from drivers.genicam.discovery import find_cameras
from drivers.genicam.driver import DRIVER
from drivers.genicam.gige import is_controlled
from drivers.limits import Limits
from drivers.readback import Setting
from instrument.rig.bounded import COMMAND_LIMIT, FRAME_MARGIN, BoundedCamera
from tests.drivers.double_clock import HANG
from tests.drivers.genicam.fake_genicam import (
    ADDRESS,
    HEIGHT,
    SERIAL_NUMBER,
    WIDTH,
    FakeGenicam,
    SecondClient,
    skip_without_aravis,
)
from tests.drivers.genicam.modern_genicam import TEMPERATURE, write_modern_description


@pytest.fixture
def fake() -> Iterator[FakeGenicam]:
    with FakeGenicam() as fake:
        yield fake


@pytest.fixture
def camera(fake: FakeGenicam) -> Iterator[GenicamCamera]:
    camera = fake.camera()
    camera.connect()
    yield camera
    camera.disconnect()


def settings_by_name(camera: GenicamCamera) -> dict[str, Setting]:
    return {each.name: each for each in camera.describe().settings}


class TestSettings:
    def test_it_tells_what_it_is(self, camera: GenicamCamera):
        found = camera.describe()
        assert (found.make, found.model, found.serial_number) == ("Aravis", "Fake", SERIAL_NUMBER)
        assert found.firmware.startswith("0.8")
        assert (found.bit_depth, found.bayer_pattern) == (16, "")

    @pytest.mark.parametrize(
        ("name", "bit_depth", "pattern"), [("Mono8", 8, ""), ("BayerRG8", 8, "RGGB"), ("Mono16", 16, "")]
    )
    def test_a_format_that_is_named_is_taken(self, fake: FakeGenicam, name: str, bit_depth: int, pattern: str):
        camera = fake.camera(pixel_format=name)
        camera.connect()
        found, counts = camera.describe(), camera.trigger().counts
        camera.disconnect()
        assert (found.bit_depth, found.bayer_pattern) == (bit_depth, pattern)
        assert 0 < counts.max() < 2**bit_depth

    def test_a_format_that_it_has_not_is_refused_with_those_that_it_has(self, fake: FakeGenicam):
        with pytest.raises(DeviceLimitError, match=r"'Mono12'; this camera has .*Mono8"):
            fake.camera(pixel_format="Mono12").connect()
        assert not is_controlled(ADDRESS), "a camera that was refused is left open"

    def test_gain_is_set_and_read_back_with_its_range(self, fake: FakeGenicam):
        camera = fake.camera(gain_db=2.0)
        camera.connect()
        gain = settings_by_name(camera)["gain"]
        camera.disconnect()
        assert gain.value == 2.0
        assert gain.limits is not None
        assert (gain.limits.low, gain.limits.high) == (0.0, 10.0)

    def test_a_gain_that_it_cuts_off_is_caught(self, fake: FakeGenicam):
        with pytest.raises(DeviceError, match=r"gain_db was set to 2.5 .*reads back 2"):
            fake.camera(gain_db=2.5).connect()

    def test_the_region_is_the_part_of_the_picture_that_was_asked_for(self, fake: FakeGenicam):
        camera = fake.camera(width=128, height=32, offset_x=10, offset_y=6)
        camera.connect()
        found, frame = settings_by_name(camera), camera.trigger()
        camera.disconnect()
        assert (found["offset_x"].value, found["offset_y"].value) == (10, 6)
        assert frame.counts.shape == (32, 128)

    def test_a_region_that_it_has_not_is_refused(self, fake: FakeGenicam):
        with pytest.raises(DeviceLimitError, match=r"width is 4096 px; this camera takes 1 to 2048"):
            fake.camera(width=4096).connect()

    def test_an_exposure_time_that_it_would_wrap_is_refused(self, camera: GenicamCamera):
        before = camera.set_exposure_time(0.02)
        with pytest.raises(DeviceLimitError, match=r"exposure_time is 1e\+12 s; allowed is 1e-05 to 10 s"):
            camera.set_exposure_time(1e12)
        assert camera.trigger().exposure_time == before


class TestTodaysCameras:
    @pytest.fixture
    def modern(self, tmp_path: Path) -> Iterator[FakeGenicam]:
        with FakeGenicam():
            write_modern_description(tmp_path / "modern.xml")
        with FakeGenicam(description=tmp_path / "modern.xml") as fake:
            yield fake

    def test_names_units_and_automatics_of_today_are_understood(self, modern: FakeGenicam):
        camera = modern.camera(pixel_format="Mono12", gain_db=2.5)
        camera.connect()
        found, settings = camera.describe(), settings_by_name(camera)
        assert (found.bit_depth, found.saturation_level) == (12, 4095.0)
        assert settings["gain"] == Setting("gain", 2.5, "dB", Limits(0.0, 24.0, "dB"))
        assert settings["black_level"] == Setting("black_level", 0.0, "%", Limits(0.0, 12.0, "%"))
        assert camera.set_exposure_time(0.0123) == pytest.approx(0.0123)
        frame = camera.trigger()
        assert (frame.counts.shape, frame.sensor_temperature) == ((HEIGHT, WIDTH), TEMPERATURE)
        link = camera._link
        assert link is not None
        assert link.text("ExposureAuto") == "Off"
        assert not link.value("GammaEnable")
        assert not link.value("AcquisitionFrameRateEnable")
        camera.disconnect()


class TestFrames:
    def test_each_trigger_gives_one_frame_and_none_comes_by_itself(self, camera: GenicamCamera):
        numbers, pictures = [], []
        for _ in range(3):
            frame = camera.trigger()
            numbers.append(frame.sequence_number)
            pictures.append(frame.counts)
            # It takes 25 pictures a second where nobody stops it.
            time.sleep(0.1)
        assert numbers == [0, 1, 2]
        # Its ramp moves on by one pixel a frame: a picture that came twice, or that is left out, would show.
        assert all((after[:, :-1] == before[:, 1:]).mean() > 0.95 for before, after in pairwise(pictures))

    def test_a_frame_of_before_is_never_handed_over(self, camera: GenicamCamera, monkeypatch: pytest.MonkeyPatch):
        first = camera.trigger().counts
        # Given up at once: the frame arrives when nobody waits for it.
        with monkeypatch.context() as patch:
            patch.setattr(camera_module, "FRAME_MARGIN", -1.0)
            with pytest.raises(DeviceTimeoutError):
                camera.trigger()
        time.sleep(0.1)
        frame = camera.trigger()
        assert frame.sequence_number == 2
        assert (frame.counts[:, :-2] == first[:, 2:]).mean() > 0.95, "two frames after the first one"

    @pytest.mark.slow
    def test_the_camera_s_own_numbers_may_begin_anew(self, camera: GenicamCamera):
        # It starts at 65400, and counts 16 bits.
        assert [camera.trigger().sequence_number for _ in range(200)] == list(range(200))

    def test_an_exposure_is_ended_by_another_thread(self, fake: FakeGenicam, camera: GenicamCamera):
        camera.set_exposure_time(10.0)
        waiting, n_naps = Event(), 0

        def wait(_: float) -> None:
            nonlocal n_naps
            n_naps += 1
            waiting.set()
            time.sleep(0.05)

        with ThreadPoolExecutor(1) as executor:
            # Its frames come at once, whatever the exposure; this one does not come at all.
            link = camera._link
            assert link is not None
            link.frame = wait
            exposing = executor.submit(camera.trigger)
            assert waiting.wait(HANG)
            camera.stop()
            n_before = n_naps
            with pytest.raises(DeviceError, match="the exposure was stopped"):
                exposing.result(HANG)
            # At most the nap under way, and one that had begun.
            assert n_naps - n_before <= 2
            del link.frame
        assert camera.trigger().counts.max() > 0

    def test_a_frame_with_a_hole_is_refused_and_the_next_whole_one_is_taken(self):
        with FakeGenicam(lost_per_thousand=15) as fake:
            camera = fake.camera(width=256, height=200)
            camera.connect()
            holes, whole = [], []
            while not (holes and whole):
                assert len(holes) + len(whole) < 60, "nothing but one kind of frame"
                try:
                    whole.append(camera.trigger())
                except DeviceTimeoutError:
                    continue  # its first packet was lost too
                except DeviceError as error:
                    holes.append(str(error))
            camera.disconnect()
        assert "incomplete" in holes[0]
        # Its ramp is the same along a diagonal, which a hole would break.
        assert all((frame.counts[1:, :-1] == frame.counts[:-1, 1:]).all() for frame in whole)


class TestFailures:
    def test_a_camera_that_goes_away_is_lost_in_time_and_comes_back(self, fake: FakeGenicam):
        notes = []
        camera = fake.camera(SERIAL_NUMBER)
        bounded = BoundedCamera(camera, Event(), lambda event, **details: notes.append(event))
        bounded.connect()
        exposure_time = bounded.set_exposure_time(0.01)
        bounded.trigger()
        fake.kill()
        begin = time.monotonic()
        with pytest.raises(DeviceLostError, match=r"is gone .*connect again"):
            bounded.trigger()
        assert time.monotonic() - begin < exposure_time + FRAME_MARGIN
        begin = time.monotonic()
        bounded.disconnect()
        assert time.monotonic() - begin < COMMAND_LIMIT
        fake.start()
        bounded.connect()
        assert bounded.trigger().sequence_number == 0
        bounded.disconnect()

    def test_a_camera_that_was_switched_off_and_on_is_lost_and_not_used_as_it_came_up(
        self, fake: FakeGenicam, camera: GenicamCamera
    ):
        camera.set_exposure_time(0.02)
        fake.kill()
        fake.start()
        with pytest.raises(DeviceLostError, match="not in our control any more"):
            camera.trigger()
        camera.disconnect()
        camera.connect()
        assert camera.trigger().sequence_number == 0

    def test_a_camera_that_another_program_has_is_refused_and_left_to_it(self, fake: FakeGenicam, monkeypatch):
        monkeypatch.setattr(finding, "CONTROL_PATIENCE", 0.0)
        other = SecondClient()
        with pytest.raises(DeviceError, match=r"is in use by another program. End the other program"):
            fake.camera().connect()
        assert is_controlled(ADDRESS)
        other.close()

    def test_a_camera_that_a_killed_program_had_is_taken_when_its_time_is_over(self, fake: FakeGenicam, monkeypatch):
        monkeypatch.setattr(finding, "CONTROL_PATIENCE", 0.5)
        SecondClient(heartbeat_ms=300).close()
        camera = fake.camera()
        camera.connect()
        assert camera.trigger().sequence_number == 0
        camera.disconnect()

    def test_a_camera_of_another_serial_number_is_refused_and_left_closed(self, fake: FakeGenicam):
        with pytest.raises(DeviceError, match=f"has serial number {SERIAL_NUMBER}, not 4711"):
            fake.camera("4711").connect()
        assert not is_controlled(ADDRESS)

    def test_after_disconnecting_the_camera_is_free(self, fake: FakeGenicam, camera: GenicamCamera):
        assert is_controlled(ADDRESS)
        camera.disconnect()
        assert not is_controlled(ADDRESS)


class TestFinding:
    def test_looking_says_which_can_be_used_and_takes_none_and_a_serial_number_leads_to_its_own(
        self, fake: FakeGenicam, monkeypatch: pytest.MonkeyPatch
    ):
        listed = listed_cameras()
        for module in (discovery, finding):
            # Each look at the network takes a second.
            monkeypatch.setattr(module, "listed_cameras", lambda: listed)
        (free,) = [each for each in DRIVER.find() if each.where == ADDRESS]
        assert (free.state, free.remedy) == (DeviceState.FOUND, "")
        assert SERIAL_NUMBER in free.name
        assert not is_controlled(ADDRESS)
        table = {"serial_number": SERIAL_NUMBER, "width": WIDTH, "height": HEIGHT}
        camera = DRIVER.open(DRIVER.settings(), table)
        camera.connect()
        (busy,) = [each for each in DRIVER.find() if each.where == ADDRESS]
        assert busy.state is DeviceState.BUSY
        assert "End the other program" in busy.remedy
        assert camera.describe().serial_number == SERIAL_NUMBER
        camera.disconnect()

    def test_without_any_camera_looking_takes_less_than_three_seconds(self):
        skip_without_aravis()
        begin = time.monotonic()
        assert [each for each in find_cameras() if SERIAL_NUMBER in each.name] == []
        assert time.monotonic() - begin < 3.0
