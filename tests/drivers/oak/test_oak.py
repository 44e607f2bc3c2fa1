import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from operator import attrgetter
from threading import Event
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from pydantic import ValidationError

from drivers.camera import Frame
from drivers.device_settings import settings_from_table
from drivers.driver import DeviceState, Driver
from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError, DriverNotFoundError
from drivers.oak import camera as camera_module
from drivers.oak import connection as connection_module
from drivers.oak import finding
from drivers.oak.camera import OakCamera
from drivers.oak.connection import check_mode, open_device
from drivers.oak.driver import DRIVER
from drivers.oak.finding import chosen, find_oak
from drivers.oak.messages import FrameFacts, counts, set_controls
from drivers.oak.raw import counts_from_bytes
from drivers.oak.sdk import depthai
from drivers.oak.settings import OakSettings
from instrument.rig.bounded import BoundedCamera
from tests.drivers.device_page import toml_of_page
from tests.drivers.double_clock import HANG
from tests.drivers.oak.oak_double import HEIGHT, SDK, WIDTH, OakDouble, packed, scene, settings_of

COMMANDS = SDK.CameraControl.Command


@pytest.fixture
def double() -> OakDouble:
    return OakDouble()


@pytest.fixture
def camera(double: OakDouble) -> Iterator[OakCamera]:
    camera = double.camera()
    camera.connect()
    yield camera
    camera.disconnect()


def info(serial: str = "A1", state: str = "UNBOOTED", status: str = "SUCCESS", protocol: str = "USB_VSC") -> Any:
    return SDK.DeviceInfo(
        "1.2",
        serial,
        getattr(SDK.XLinkDeviceState, f"X_LINK_{state}"),
        getattr(SDK.XLinkProtocol, f"X_LINK_{protocol}"),
        SDK.XLinkPlatform.X_LINK_MYRIAD_X,
        getattr(SDK.XLinkError_t, f"X_LINK_{status}"),
    )


def frames(camera: OakCamera, n_frames: int) -> list[Frame]:
    return [camera.trigger() for _ in range(n_frames)]


LOCKED = ("", "UNBOOTED", "INSUFFICIENT_PERMISSIONS")


class TestFinding:
    def test_a_camera_that_is_not_there_is_reported_within_a_second(self):
        began = time.monotonic()
        with pytest.raises(DeviceError, match=r"no OAK camera with serial number X .*found: .*cable .*power.*03e7"):
            OakCamera(settings_of(), "X", HEIGHT, WIDTH).connect()
        assert time.monotonic() - began < 1.0

    def test_the_only_one_is_the_one_that_is_meant(self):
        assert chosen([info("A1")], None).deviceId == "A1"

    def test_of_several_the_serial_number_decides(self):
        assert chosen([info("A1"), info("B2"), info(*LOCKED)], "B2").deviceId == "B2"
        with pytest.raises(DeviceError, match=r"2 OAK cameras are there: A1 at USB 1.2 \(found\); B2.*serial_number"):
            chosen([info("A1"), info("B2")], None)

    def test_another_one_is_named_but_not_taken(self):
        with pytest.raises(DeviceError, match=r"no OAK camera with serial number C3 is there; found: A1 at network"):
            chosen([info("A1", protocol="TCP_IP")], "C3")

    @pytest.mark.parametrize(
        ("device", "mend"),
        [
            (LOCKED, "60-halfangle.rules"),
            (("A1", "BOOTED"), "close the program that uses it"),
            (("A1", "UNBOOTED", "DEVICE_ALREADY_IN_USE"), "close the program that uses it"),
            (("A1", "UNBOOTED", "ERROR"), "plug it in again"),
        ],
    )
    def test_one_that_cannot_be_opened_comes_with_its_mend(self, device, mend: str):
        with pytest.raises(DeviceError, match=f"cannot be opened; found: .*Next: .*{mend}"):
            chosen([info(*device)], None)

    def test_lists_each_with_its_state(self, monkeypatch):
        devices = [info("A1"), info(*LOCKED), info("B2", "BOOTED"), info("C3", "FLASH_BOOTED", protocol="TCP_IP")]
        monkeypatch.setattr(finding, "listed", lambda _: devices)
        found = list(find_oak())
        assert [device.state for device in found] == [
            DeviceState.FOUND,
            DeviceState.NO_PERMISSION,
            DeviceState.BUSY,
            DeviceState.FOUND,
        ]
        assert [device.name.split()[-1] for device in found][::2] == ["A1", "B2"]
        assert [bool(device.remedy) for device in found] == [False, True, True, False]

    @pytest.mark.parametrize("act", [lambda: list(find_oak()), lambda: open_device(settings_of(), None, HEIGHT, WIDTH)])
    def test_says_so_where_the_sdk_is_missing(self, monkeypatch, act):
        monkeypatch.setitem(sys.modules, "depthai", None)
        with pytest.raises(DriverNotFoundError, match=r'pip install "halfangle\[oak\]"'):
            act()

    def test_an_sdk_of_the_old_interface_is_refused(self, monkeypatch):
        monkeypatch.setattr(SDK, "__version__", "2.30.0")
        with pytest.raises(DriverNotFoundError, match=r"depthai is 2\.30\.0; 3 is needed"):
            depthai()

    def test_the_sdk_tells_nobody_what_it_does(self):
        assert os.environ["DEPTHAI_TELEMETRY"] == "0"
        assert os.environ["DEPTHAI_DISABLE_FEEDBACK"] == "1"


class TestOpening:
    """Short of a camera, that the SDK has what opens one."""

    @pytest.mark.parametrize(
        "name",
        [
            "Device.close",
            "Device.getConnectedCameraFeatures",
            "Device.getDeviceId",
            "Device.getDeviceName",
            "Device.getProductName",
            "Device.setMaxReconnectionAttempts",
            "CameraBoardSocket.CAM_D",
            "node.Camera.build",
            "node.Camera.initialControl",
            "node.Camera.inputControl",
            "node.Camera.raw",
        ],
    )
    def test_the_sdk_has_what_is_called(self, name: str):
        assert attrgetter(name)(SDK) is not None

    def test_the_sensor_is_built_with_its_mode(self):
        assert "boardSocket" in SDK.node.Camera.build.__doc__
        assert "sensorResolution" in SDK.node.Camera.build.__doc__
        assert "sensorFps" in SDK.node.Camera.build.__doc__

    def test_a_pipeline_belongs_to_a_device(self):
        assert "defaultDevice: depthai.Device" in SDK.Pipeline.__init__.__doc__


class TestModes:
    @staticmethod
    def features(*modes: tuple[int, int, float]) -> list[Any]:
        feature = SDK.CameraFeatures()
        feature.socket = SDK.CameraBoardSocket.CAM_A
        configs = []
        for width, height, slowest in modes:
            config = SDK.CameraSensorConfig()
            config.width, config.height, config.minFps = width, height, slowest
            configs.append(config)
        feature.configs = configs
        return [feature]

    def test_a_mode_that_the_sensor_has_is_taken(self):
        check_mode(self.features((WIDTH, HEIGHT, 1.4), (4056, 3040, 1.4)), settings_of(), WIDTH, HEIGHT)

    def test_a_sensor_that_tells_no_modes_is_believed(self):
        check_mode(self.features(), settings_of(), WIDTH, HEIGHT)

    def test_what_it_does_not_have_is_told_with_what_it_has(self):
        with pytest.raises(DeviceError, match=r"no mode of 10 x 6; it has 4056 x 3040, 1920 x 1080"):
            check_mode(self.features((4056, 3040, 1.4), (1920, 1080, 1.4)), settings_of(), WIDTH, HEIGHT)
        with pytest.raises(DeviceError, match="no sensor at CAM_B; it has CAM_A"):
            check_mode(self.features(), settings_of(socket="CAM_B"), WIDTH, HEIGHT)

    def test_exposures_longer_than_its_slowest_frame_are_refused(self):
        with pytest.raises(DeviceError, match=r"longest_exposure_s is 0\.5 s, 1\.8 frames per second.*has 2 at least"):
            check_mode(self.features((WIDTH, HEIGHT, 2.0)), settings_of(longest_exposure_s=0.5), WIDTH, HEIGHT)


class TestControls:
    def test_nothing_is_automatic(self):
        control = set_controls(SDK, SDK.CameraControl(), settings_of(iso=200, lens_position=120), 0.0123)
        assert control.getExposureTime().total_seconds() == 0.0123
        assert (control.getSensitivity(), control.wbColorTemp, control.getLensPosition()) == (200, 5000, 120)
        given_commands = {name for name, command in COMMANDS.__members__.items() if control.getCommand(command)}
        assert given_commands == {"AE_MANUAL", "WB_COLOR_TEMP", "AF_MODE", "MOVE_LENS", "ANTIBANDING_MODE"}
        assert control.autoFocusMode == SDK.CameraControl.AutoFocusMode.OFF

    def test_a_fixed_lens_is_left_alone(self):
        assert not set_controls(SDK, SDK.CameraControl(), settings_of(), 0.01).getCommand(COMMANDS.MOVE_LENS)

    def test_each_exposure_is_sent_to_the_sensor(self, camera: OakCamera, double: OakDouble):
        camera.set_exposure_time(0.002)
        sent = [control.getExposureTime().total_seconds() for control in double.sensor.received]
        assert sent == [0.03, 0.002]


class TestRawFrames:
    @given(
        counts=arrays.arrays(np.uint16, st.tuples(st.integers(1, 4), st.integers(1, 9)), elements=st.integers(0, 1023)),
        padding=st.integers(0, 5),
    )
    def test_packed_rows_are_unpacked_bit_by_bit(self, counts, padding: int):
        height, width = counts.shape
        row_bytes = -(-width // 4) * 5 + padding
        if row_bytes >= 2 * width:
            return  # so few pixels, so much padding: nothing tells such rows from unpacked ones
        unpacked = counts_from_bytes(packed(counts, padding), height, width, row_bytes, 10)
        np.testing.assert_array_equal(unpacked, counts)
        assert unpacked.dtype == np.uint16

    def test_twelve_bits_are_packed_in_pairs(self):
        # 0xABC and 0x123: their high bytes, then the low half bytes, of the first one lowest.
        data = np.array([0xAB, 0x12, 0x3C, 0xFF], np.uint8)
        assert counts_from_bytes(data, 1, 2, 3, 12).tolist() == [[0xABC, 0x123]]

    @pytest.mark.parametrize("bit_depth", [10, 12, 14, 16])
    def test_words_are_taken_as_they_are(self, bit_depth: int):
        counts = np.array([[0, 2**bit_depth - 1], [5, 6]], np.uint16)
        data = np.frombuffer(counts.astype("<u2").tobytes() + b"behind", np.uint8)
        np.testing.assert_array_equal(counts_from_bytes(data, 2, 2, 4, bit_depth), counts)

    def test_counts_aligned_to_the_left_are_no_counts_of_ten_bits(self):
        data = np.array([0, 4, 0, 0xFC], np.uint8)
        with pytest.raises(DeviceError, match=r"counts up to 64512; 10 bits hold 1023\. Correct bit_depth: 16"):
            counts_from_bytes(data, 1, 2, 4, 10)

    def test_a_frame_that_was_cut_short_is_refused(self):
        with pytest.raises(DeviceError, match="a frame has 29 bytes and should have 30"):
            counts_from_bytes(np.zeros(29, np.uint8), 2, 12, 15, 10)

    @pytest.mark.parametrize(("bit_depth", "hint"), [(10, "or 15 packed"), (14, "14 bits need 24. ")])
    def test_rows_that_are_too_short_are_refused(self, bit_depth: int, hint: str):
        with pytest.raises(DeviceError, match=f"a row of 12 pixels has 14 bytes; .*{hint}"):
            counts_from_bytes(np.zeros(28, np.uint8), 2, 12, 14, bit_depth)

    @pytest.mark.parametrize("kind", ["NV12", "RAW12", "RAW8"])
    def test_another_format_is_refused(self, kind: str):
        frame = SDK.ImgFrame()
        frame.setType(getattr(SDK.ImgFrame.Type, kind))
        frame.setSize(WIDTH, HEIGHT)
        with pytest.raises(DeviceError, match=f"a frame is {kind}; expected was a raw one with 10 bits"):
            counts(frame, HEIGHT, WIDTH, 10)

    def test_another_size_is_refused(self):
        frame = SDK.ImgFrame()
        frame.setType(SDK.ImgFrame.Type.RAW16)
        frame.setSize(12, 8)
        with pytest.raises(DeviceError, match=r"a frame is 12 x 8; expected was 10 x 6\. Correct width and height"):
            counts(frame, HEIGHT, WIDTH, 10)

    def test_tells_when_its_exposure_began(self):
        frame = SDK.ImgFrame()
        told = frame.cam
        told.exposureTimeUs, told.sensitivityIso = 12_000, 100
        frame.cam = told
        ended = SDK.Clock.now()
        frame.setTimestamp(ended)
        facts = FrameFacts.of(SDK, frame)
        assert facts.began == pytest.approx(ended.total_seconds() - 0.012)
        assert (facts.exposure_time, facts.iso) == (0.012, 100)
        assert np.isnan(facts.sensor_temperature)


class TestFrames:
    @pytest.mark.parametrize("packs", [True, False])
    def test_counts_come_through_the_pipeline_as_the_sensor_made_them(self, double: OakDouble, packs: bool):
        double.faults = {"packs": packs, "temperature": 41.5}
        camera = double.camera()
        camera.connect()
        camera.set_exposure_time(0.02)
        frame = camera.trigger()
        camera.disconnect()
        np.testing.assert_array_equal(frame.counts, scene(20_000))
        assert frame.sensor_temperature == 41.5

    def test_frames_of_the_exposure_before_are_passed_over(self, double: OakDouble):
        double.faults = {"delay": 15}
        camera = double.camera()
        camera.connect()
        for exposure_time in (0.001, 0.004, 0.001):
            assert camera.set_exposure_time(exposure_time) == exposure_time
            np.testing.assert_array_equal(camera.trigger().counts, scene(round(exposure_time * 1e6)))
        camera.disconnect()

    def test_a_frame_that_began_before_the_trigger_is_never_handed_over(self, camera: OakCamera):
        camera.set_exposure_time(0.03)
        for _ in range(3):
            began = time.monotonic()
            camera.trigger()
            # Frames come every 2 ms, and the queue holds older ones: none of those can be it.
            assert time.monotonic() - began > 0.029

    def test_what_whole_lines_make_of_an_exposure_is_read_back(self, double: OakDouble):
        double.faults = {"line_us": 30}
        camera = double.camera()
        camera.connect()
        assert camera.set_exposure_time(0.001) == 0.00099
        assert camera.trigger().exposure_time == 0.00099
        camera.disconnect()

    def test_a_camera_that_ignores_its_controls_is_found_out_when_it_connects(self, double: OakDouble):
        double.faults = {"heeds": False, "exposure_us": 5000}
        with pytest.raises(DeviceError, match=r"exposure_time was set to 0\.03 s and reads back 0\.005 s"):
            double.camera().connect()
        assert double.n_closed == 1

    def test_a_camera_that_ignores_a_control_is_given_up_in_time(
        self, camera: OakCamera, double: OakDouble, monkeypatch
    ):
        monkeypatch.setattr(camera_module, "_SETTLING_LIMIT", 0.2)
        double.sensor.heeds = False
        with pytest.raises(DeviceError, match=r"exposure_time was set to 0\.001 s and reads back 0\.03 s"):
            camera.set_exposure_time(0.001)

    def test_another_sensitivity_than_was_asked_for_is_refused(self, camera: OakCamera, double: OakDouble):
        double.sensor.iso_told = 800
        with pytest.raises(DeviceError, match="iso was set to 100 ISO and reads back 800 ISO"):
            camera.trigger()
        double.sensor.iso_told = None
        camera.trigger()

    def test_an_exposure_that_changes_by_itself_is_refused(self, camera: OakCamera, double: OakDouble):
        double.sensor.control.send(set_controls(SDK, SDK.CameraControl(), settings_of(), 0.02))
        with pytest.raises(DeviceError, match=r"exposure_time was set to 0\.03 s and reads back 0\.02 s"):
            frames(camera, 20)

    def test_a_frame_that_comes_again_is_not_another_one(self, camera: OakCamera, double: OakDouble, monkeypatch):
        camera.trigger()
        monkeypatch.setattr(camera_module, "_FRAME_MARGIN", 0.1)
        double.sensor.counts_frames = False
        time.sleep(0.05)
        with pytest.raises(DeviceTimeoutError, match="no new frame"):
            frames(camera, 2)

    def test_a_frame_that_never_comes_ends_in_time(self, camera: OakCamera, double: OakDouble, monkeypatch):
        monkeypatch.setattr(camera_module, "_FRAME_MARGIN", 0.1)
        double.sensor.is_silent = True
        time.sleep(0.02)
        with pytest.raises(DeviceTimeoutError, match=r"no new frame of the OAK camera within 0\.2 s"):
            camera.trigger()

    def test_a_wait_is_ended_by_another_thread(self, camera: OakCamera, double: OakDouble, monkeypatch):
        # Nothing else would end it.
        monkeypatch.setattr(camera_module, "_FRAME_MARGIN", 10.0 * HANG)
        double.sensor.is_silent = True
        with ThreadPoolExecutor(1) as executor:
            frame = executor.submit(camera.trigger)
            time.sleep(0.1)
            camera.stop()
            with pytest.raises(DeviceError, match="the exposure was stopped"):
                frame.result(HANG)

    def test_bounded_calls_work(self, camera: OakCamera):
        bounded = BoundedCamera(camera, Event(), lambda *_, **__: None)
        bounded.set_exposure_time(0.002)
        assert bounded.trigger().exposure_time == 0.002


class TestGone:
    def test_a_camera_that_is_unplugged_is_lost_and_can_be_connected_again(self, double: OakDouble, monkeypatch):
        # Nothing else would end a wait.
        monkeypatch.setattr(camera_module, "_FRAME_MARGIN", 10.0 * HANG)
        camera = double.camera()
        camera.connect()
        camera.trigger()
        double.unplug()
        with pytest.raises(DeviceLostError, match=r"the OAK camera is gone.*connect again"):
            camera.trigger()
        assert double.n_closed == 1
        with pytest.raises(DeviceError, match="not connected"):
            camera.trigger()
        camera.connect()
        assert camera.trigger().sequence_number == 0
        camera.disconnect()

    def test_unplugged_while_somebody_waits(self, camera: OakCamera, double: OakDouble, monkeypatch):
        monkeypatch.setattr(camera_module, "_FRAME_MARGIN", 10.0 * HANG)
        double.sensor.is_silent = True
        with ThreadPoolExecutor(1) as executor:
            frame = executor.submit(camera.trigger)
            time.sleep(0.1)
            double.unplug()
            with pytest.raises(DeviceLostError, match="gone"):
                frame.result(HANG)

    def test_unplugged_before_a_control(self, camera: OakCamera, double: OakDouble):
        double.unplug()
        with pytest.raises(DeviceLostError, match="gone"):
            camera.set_exposure_time(0.001)


class TestSettings:
    def test_tells_what_it_is_set_to(self, double: OakDouble):
        camera = double.camera(bayer_pattern="GRBG", black_level=64.0, conversion_gain=2.5, longest_exposure_s=0.1)
        camera.connect()
        described = camera.describe()
        camera.disconnect()
        assert (described.make, described.model, described.serial_number) == ("Luxonis", "OAK-1", "14442C10D13EABCE00")
        assert (described.bayer_pattern, described.bit_depth) == ("GRBG", 10)
        assert (described.black_level, described.saturation_level, described.conversion_gain) == (64.0, 1023.0, 2.5)
        assert np.isnan(described.read_noise)
        assert described.exposure_time_limits.high == 0.1
        assert list(map(str, described.settings)) == ["iso 100 ISO", "white_balance 5000 K", "frame_rate 9 Hz"]

    def test_the_page_shows_a_table_that_the_driver_takes(self):
        table = toml_of_page('driver = "oak"')["camera"]
        settings = settings_from_table(OakSettings, table["device"])
        assert (settings.lens_position, settings.clipping_count) == (130, 1023.0)
        assert DRIVER.open(settings, table) is not None

    def test_the_longest_exposure_fits_into_a_frame(self):
        for longest in (0.001, 0.03, 0.1, 0.5):
            settings = settings_of(longest_exposure_s=longest)
            assert longest <= 1.0 / settings.frame_rate
            assert settings.exposure_time_limits.high == longest

    def test_what_no_camera_takes_is_said_at_once(self):
        with pytest.raises(ValidationError) as caught:
            settings_of(iso=50, white_balance_k=100, bit_depth=11, socket="CAM_Z", bayer_pattern="RGBG", lens=1)
        for key in ("iso", "white_balance_k", "bit_depth", "socket", "bayer_pattern", "lens"):
            assert key in str(caught.value)

    def test_the_driver_opens_what_the_table_says(self, monkeypatch):
        monkeypatch.setattr(connection_module, "listed", lambda _: [])
        table = {"serial_number": "A1", "width": WIDTH, "height": HEIGHT}
        camera = DRIVER.open(settings_of(), table)
        with pytest.raises(DeviceError, match="no OAK camera with serial number A1 is there; found: none"):
            camera.connect()
        assert isinstance(DRIVER, Driver)
        assert (DRIVER.kind, DRIVER.find) == ("camera", find_oak)
