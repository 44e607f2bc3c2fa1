"""What the GenICam driver makes of settings, formats and frames, without Aravis."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pydantic import ValidationError

from drivers.device_settings import settings_from_table
from drivers.driver import DeviceState
from drivers.errors import DeviceError, DeviceLimitError, DeviceLostError, DeviceTimeoutError, DriverNotFoundError
from drivers.genicam import aravis, camera
from drivers.genicam.driver import DRIVER
from drivers.genicam.link import RawFrame, Region, Steps
from drivers.genicam.listing import ListedCamera, choose
from drivers.genicam.pixels import deepest, raw_format, shifted_pattern
from drivers.genicam.settings import GenicamSettings
from drivers.genicam.usb import UDEV_RULES, usb_cameras
from drivers.limits import Limits
from drivers.readback import Setting
from tests.drivers.genicam.genicam_link_double import HEIGHT, WIDTH, LinkDouble, camera_of

BLACKFLY = ListedCamera("FLIR-Blackfly-1", "FLIR", "Blackfly", "1", "192.168.0.5", "GigEVision")
GRASSHOPPER = ListedCamera("PGR-Grasshopper3-2", "PGR", "Grasshopper3", "2", "USB3", "USB3Vision")


@pytest.fixture
def link() -> LinkDouble:
    return LinkDouble()


def setting(described: tuple[Setting, ...], name: str) -> Setting:
    return next(each for each in described if each.name == name)


def connected(link: LinkDouble, **settings: Any):
    device = camera_of(link, **settings)
    device.connect()
    return device


class TestPixelFormats:
    @pytest.mark.parametrize(
        ("name", "bit_depth", "pattern"),
        [("Mono8", 8, ""), ("Mono12", 12, ""), ("BayerRG10", 10, "RGGB"), ("BayerBG16", 16, "BGGR"),
         ("BayerGB14", 14, "GBRG"), ("BayerGR8", 8, "GRBG")],
    )  # fmt: skip
    def test_a_raw_format_says_bits_and_colours(self, name: str, bit_depth: int, pattern: str):
        assert (raw_format(name).bit_depth, raw_format(name).bayer_pattern) == (bit_depth, pattern)

    @pytest.mark.parametrize("name", ["Mono12p", "Mono12Packed", "BayerRG10p", "BayerGB12Packed"])
    def test_a_packed_format_is_refused_by_what_it_is(self, name: str):
        with pytest.raises(ValueError, match=f"{name}', which is packed; allowed are .*e.g. Mono12"):
            raw_format(name)

    @pytest.mark.parametrize("name", ["RGB8", "YUV422_8", "mono8", "Mono9", ""])
    def test_what_is_not_raw_is_refused(self, name: str):
        with pytest.raises(ValueError, match="is no raw format"):
            raw_format(name)

    @pytest.mark.parametrize(
        ("available", "best"),
        [
            (["Mono8", "Mono16", "Mono12p"], "Mono16"),
            (["Mono8", "Mono12", "Mono12Packed"], "Mono12"),
            (["Mono12", "BayerRG12", "RGB8"], "BayerRG12"),
        ],
    )
    def test_the_deepest_is_taken_and_colours_before_their_sum(self, available: list[str], best: str):
        assert deepest(available).name == best

    def test_a_camera_with_nothing_raw_is_told_so(self):
        with pytest.raises(DeviceError, match=r"has the pixel formats Mono12p, RGB8; allowed are"):
            deepest(["RGB8", "Mono12p"])

    @pytest.mark.parametrize("name", ["Mono8", "BayerRG10", "Mono12", "Mono16"])
    def test_counts_come_back_as_they_were_right_aligned(self, name: str):
        pixels = raw_format(name)
        counts = np.arange(12, dtype=np.uint16).reshape(3, 4) * ((2**pixels.bit_depth - 1) // 11)
        found = pixels.counts(counts.astype(pixels.dtype).tobytes(), 3, 4)
        assert found.dtype == np.uint16
        assert_array_equal(found, counts)

    def test_padding_after_a_frame_is_no_part_of_it(self):
        assert_array_equal(raw_format("Mono8").counts(bytes(range(8)), 2, 3), [[0, 1, 2], [3, 4, 5]])

    def test_a_short_frame_is_refused(self):
        with pytest.raises(DeviceError, match="11 bytes; 3 x 2 pixels of Mono12 are 12"):
            raw_format("Mono12").counts(bytes(11), 2, 3)

    def test_counts_that_fill_their_bits_from_the_left_are_refused(self):
        with pytest.raises(DeviceError, match="is 65520; Mono12 ends at 4095"):
            raw_format("Mono12").counts(np.full(6, 4095 << 4, "<u2").tobytes(), 2, 3)

    @pytest.mark.parametrize("pattern", ["RGGB", "BGGR", "GRBG", "GBRG"])
    @pytest.mark.parametrize("offset", [(0, 0), (1, 0), (0, 1), (1, 1), (2, 3)])
    def test_a_shifted_pattern_names_the_colours_that_are_there(self, pattern: str, offset: tuple[int, int]):
        x, y = offset
        sensor = np.tile(np.array(list(pattern)).reshape(2, 2), (4, 4))
        assert shifted_pattern(pattern, x, y) == "".join(sensor[y : y + 2, x : x + 2].ravel())

    def test_monochrome_has_no_pattern_to_shift(self):
        assert shifted_pattern("", 1, 1) == ""


class TestSettings:
    def test_a_table_may_be_empty(self):
        assert settings_from_table(GenicamSettings, {}) == GenicamSettings()

    def test_every_key_is_described(self):
        assert all(each.description for each in GenicamSettings.model_fields.values())

    @pytest.mark.parametrize(
        ("key", "value", "message"),
        [("pixel_format", "Mono12p", "which is packed"), ("offset_x", -2, "greater than or equal to 0"),
         ("conversion_gain", 0.0, "greater than 0"), ("gain", 3.0, "Extra inputs")],
    )  # fmt: skip
    def test_what_cannot_be_is_refused(self, key: str, value: object, message: str):
        with pytest.raises(ValidationError, match=message):
            settings_from_table(GenicamSettings, {key: value})

    def test_the_driver_opens_what_the_table_of_the_camera_says(self):
        table = {"serial_number": "42", "width": 640, "height": 480}
        device = DRIVER.open(DRIVER.settings(), table)
        assert isinstance(device, camera.GenicamCamera)


class TestConfiguring:
    def test_it_takes_the_deepest_format_and_a_centred_region(self, link: LinkDouble):
        found = connected(link).describe()
        assert (found.bit_depth, found.bayer_pattern, found.saturation_level) == (12, "RGGB", 4095.0)
        assert link.place == Region(952, 596, WIDTH, HEIGHT)
        assert link.features["PixelFormat"] == "BayerRG12"

    def test_whatever_changes_by_itself_is_switched_off(self, link: LinkDouble):
        connected(link)
        assert (link.features["ExposureAuto"], link.features["GainAuto"]) == ("Off", "Off")
        assert not link.features["GammaEnable"]
        assert not link.features["AcquisitionFrameRateEnable"]

    @pytest.mark.parametrize(
        ("feature", "value", "choices", "neutral"),
        [
            ("Gamma", 0.45, (), 1.0),
            ("EdgeFilter", "Sharpen1", ("Smooth1", "Off", "Sharpen1"), "Off"),
            ("IrisAuto", "Continuous", ("Off", "Continuous"), "Off"),
            ("pgrHDRModeEnabled", True, (), False),
            ("DigitalShift", 2.0, (), 0.0),
            ("ContrastEnable", True, (), False),
            ("BslContrastMode", "SCurve", ("Linear", "SCurve"), "Linear"),
            ("NoiseReduction", 1.5, (), 0.0),
            ("ColorTransformationEnable", True, (), False),
            ("TestPattern", "GreyHorizontalRamp", ("Off", "GreyHorizontalRamp"), "Off"),
            ("SequencerMode", "On", ("On", "Off"), "Off"),
            ("ExposureMode", "TriggerWidth", ("Off", "Timed", "TriggerWidth"), "Timed"),
            ("DecimationVertical", 2.0, (), 1.0),
        ],
    )
    def test_what_alters_counts_is_put_to_where_it_does_not(
        self, link: LinkDouble, feature: str, value: Any, choices: tuple[str, ...], neutral: Any
    ):
        del link.features["GammaEnable"]
        link.features[feature] = value
        link.selections[feature] = choices
        connected(link)
        assert link.features[feature] == neutral

    def test_a_gamma_that_is_switched_off_may_have_any_value(self, link: LinkDouble):
        link.features["Gamma"] = 0.45
        link.locked = ("Gamma",)
        connected(link)
        assert link.features["GammaEnable"] is False

    def test_the_white_balance_of_every_colour_is_one(self, link: LinkDouble):
        link.features |= {"BalanceRatio": {"Red": 1.6, "Blue": 2.1}, "BalanceRatioSelector": "Blue"}
        link.selections["BalanceRatioSelector"] = ("Red", "Blue")
        connected(link)
        assert link.features["BalanceRatio"] == {"Red": 1.0, "Blue": 1.0}

    def test_gain_is_set_for_all_parts_of_the_camera(self, link: LinkDouble):
        link.features["GainSelector"] = "DigitalAll"
        link.selections["GainSelector"] = ("All", "DigitalAll")
        connected(link)
        assert link.features["GainSelector"] == "All"

    def test_a_camera_that_cannot_be_linear_is_refused_with_all_that_bends_its_counts(self, link: LinkDouble):
        link.features |= {"Gamma": 0.45, "EdgeFilter": "Sharpen1"}
        del link.features["GammaEnable"]
        link.selections["EdgeFilter"] = ("Sharpen1", "Sharpen2")
        link.locked = ("Gamma",)
        with pytest.raises(DeviceError) as refused:
            connected(link)
        assert "Gamma was set to 1 and reads back 0.45 (counts are bent): Gamma is locked" in str(refused.value)
        assert "EdgeFilter is Sharpen1, and none of its choices does nothing" in str(refused.value)
        assert not link.is_open

    @pytest.mark.parametrize("feature", ["GainAuto", "GammaEnable", "PixelFormat"])
    def test_what_does_not_take_a_setting_is_named_and_left_closed(self, link: LinkDouble, feature: str):
        link.stubborn = (feature,)
        with pytest.raises(DeviceError, match=r"(GainAuto|GammaEnable|pixel_format) was set to .* and reads back"):
            connected(link)
        assert not link.is_open

    def test_settings_are_described_with_unit_and_limits(self, link: LinkDouble):
        found = connected(link, gain_db=6.0).describe().settings
        assert setting(found, "gain") == Setting("gain", 6.0, "dB", Limits(-2.0, 24.0, "dB"))
        assert setting(found, "black_level") == Setting("black_level", 1.5, "%", Limits(0.0, 10.0, "%"))
        assert setting(found, "pixel_format").choices == link.formats
        assert setting(found, "width").value == WIDTH

    def test_a_gain_outside_the_range_is_refused(self, link: LinkDouble):
        with pytest.raises(DeviceLimitError, match=r"gain_db is 30 dB; allowed is -2 to 24 dB"):
            connected(link, gain_db=30.0)

    def test_a_gain_that_reads_back_another_one_is_an_error(self, link: LinkDouble):
        link.keep = lambda name, value: value % 4.0 if name == "gain" else value
        with pytest.raises(DeviceError, match=r"gain_db was set to 6 dB and reads back 2 dB"):
            connected(link, gain_db=6.0)

    def test_at_no_gain_a_camera_whose_range_begins_above_takes_its_lowest(self, link: LinkDouble):
        link.ranges["gain"] = (3.0, 24.0)
        assert setting(connected(link).describe().settings, "gain").value == 3.0

    def test_a_gain_for_a_camera_without_one_is_refused(self, link: LinkDouble):
        del link.numbers["gain"]
        with pytest.raises(DeviceLimitError, match="this camera has no gain"):
            connected(link, gain_db=3.0)

    def test_a_region_that_cannot_be_is_refused_with_all_that_is_wrong(self, link: LinkDouble):
        device = camera_of(link, width=1928, height=1201, offset_x=3)
        with pytest.raises(DeviceLimitError) as refused:
            device.connect()
        assert "[camera] width is 1928 px; this camera takes 16 to 1920 in steps of 16" in str(refused.value)
        assert "[camera] height is 1201 px" in str(refused.value)
        assert "[camera.device] offset_x is 3 px" in str(refused.value)

    def test_an_offset_that_leaves_the_sensor_is_refused(self, link: LinkDouble):
        with pytest.raises(DeviceLimitError, match=r"offset_y is 1194 px; this camera takes 0 to 1192"):
            connected(link, offset_y=1194)

    def test_a_region_that_is_not_kept_is_an_error(self, link: LinkDouble, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr(link, "set_region", lambda region: None)
        with pytest.raises(DeviceError, match=r"the region was set to .* and reads back"):
            connected(link)

    def test_an_odd_offset_shifts_the_colours(self, link: LinkDouble):
        link.sides["x_offset"] = Steps(0, 1904, 1)
        assert connected(link, offset_x=101).describe().bayer_pattern == "GRBG"

    def test_a_camera_that_renames_its_format_with_the_offset_is_believed(self, link: LinkDouble):
        link.sides["x_offset"] = Steps(0, 1904, 1)
        link.formats += ("BayerGR12",)

        def rename(region: Region) -> None:
            link.place = region
            link.features["PixelFormat"] = "BayerGR12" if region.x % 2 else "BayerRG12"

        link.set_region = rename
        assert connected(link, offset_x=101, pixel_format="BayerRG12").describe().bayer_pattern == "GRBG"

    def test_a_centred_region_keeps_the_pattern_even_where_any_offset_is_allowed(self, link: LinkDouble):
        link.sides |= {"x_offset": Steps(0, 1904, 1), "y_offset": Steps(0, 1198, 1)}
        device = camera_of(link, width=1902 // 16 * 16, height=1198)
        device.connect()
        assert (link.place.x % 2, link.place.y % 2) == (0, 0)

    def test_what_the_data_sheet_says_is_passed_on_and_what_it_does_not_is_unknown(self, link: LinkDouble):
        found = connected(link, conversion_gain=2.5, black_level=64.0, saturation_level=4000.0).describe()
        assert (found.conversion_gain, found.black_level, found.saturation_level) == (2.5, 64.0, 4000.0)
        assert np.isnan(found.read_noise)


class TestExposureTimes:
    def test_a_value_that_the_camera_wraps_in_silence_is_caught(self, link: LinkDouble):
        link.keep = lambda name, value: value % 4.294967296
        device = connected(link)
        with pytest.raises(DeviceError, match=r"exposure_time was set to 10 s and reads back 1.41"):
            device.set_exposure_time(10.0)

    def test_a_time_in_steps_of_the_camera_is_reported_as_it_is(self, link: LinkDouble):
        link.keep = lambda name, value: round(value / 30e-6) * 30e-6
        device = connected(link)
        assert device.set_exposure_time(1e-4) == pytest.approx(9e-5)
        assert device.trigger().exposure_time == pytest.approx(9e-5)

    @pytest.mark.parametrize("exposure_time", [1e12, 0.0, -1.0, float("nan")])
    def test_a_time_outside_the_range_is_refused_before_it_is_set(self, link: LinkDouble, exposure_time: float):
        device = connected(link)
        with pytest.raises(DeviceLimitError, match=r"allowed is 1e-05 to 30 s"):
            device.set_exposure_time(exposure_time)
        assert link.numbers["exposure_time"] == 0.01


class TestFrames:
    def test_triggers_are_counted_whatever_the_camera_counts(self, link: LinkDouble):
        link.ids = [65534, 65535, 1, 2]
        device = connected(link)
        assert [device.trigger().sequence_number for _ in range(4)] == [0, 1, 2, 3]
        assert link.n_starts == 1

    @pytest.mark.parametrize("later", [7, 9, 3, 0])
    def test_a_frame_of_another_number_is_refused_and_the_next_is_taken_anew(self, link: LinkDouble, later: int):
        link.ids = [7, later, 20]
        device = connected(link)
        device.trigger()
        with pytest.raises(DeviceError, match=f"number {later} after 7: it is not the one of this trigger"):
            device.trigger()
        assert device.trigger().sequence_number == 2
        assert link.n_starts == 2

    def test_a_frame_that_nobody_asked_for_is_dropped(self, link: LinkDouble):
        device = connected(link)
        device.trigger()
        link.late = [RawFrame(2, "", bytes([255] * (2 * WIDTH * HEIGHT)))]
        link.ids = [3]
        assert device.trigger().counts.max() == 0

    def test_an_incomplete_frame_is_refused_with_what_it_lacks(self, link: LinkDouble):
        device = connected(link)
        link.pending = [RawFrame(1, "12 packets are missing (status missing-packets)", b"")]
        link.frame = lambda seconds: link.pending.pop() if seconds else None
        link.trigger = lambda: None
        with pytest.raises(DeviceError, match=r"incomplete: 12 packets are missing .*net.core.rmem_max"):
            device.trigger()

    def test_no_frame_is_a_timeout_where_the_camera_still_answers(self, link: LinkDouble, monkeypatch):
        monkeypatch.setattr(camera, "FRAME_MARGIN", 0.05)
        device = connected(link)
        link.trigger = lambda: None
        with pytest.raises(DeviceTimeoutError, match=r"no frame arrived within 0\.06 s"):
            device.trigger()

    def test_no_frame_is_a_loss_where_it_does_not(self, link: LinkDouble, monkeypatch):
        monkeypatch.setattr(camera, "FRAME_MARGIN", 0.05)
        device = connected(link)
        # It takes the trigger, and is gone.
        monkeypatch.setattr(link, "trigger", lambda: setattr(link, "is_there", False))
        begin = time.monotonic()
        with pytest.raises(DeviceLostError):
            device.trigger()
        assert time.monotonic() - begin >= 0.05

    def test_the_sensor_s_temperature_is_passed_on(self, link: LinkDouble):
        link.warmth = 41.5
        assert connected(link).trigger().sensor_temperature == 41.5


class TestChoosing:
    def test_the_one_that_is_meant_is_taken(self):
        both = (BLACKFLY, GRASSHOPPER)
        assert choose(both, "", "2", "") is GRASSHOPPER
        assert choose(both, "192.168.0.5", None, "") is BLACKFLY
        assert choose(both, "FLIR-Blackfly-1", None, "") is BLACKFLY
        assert choose((BLACKFLY,), "", None, "") is BLACKFLY

    def test_none_at_all_says_where_to_look(self):
        with pytest.raises(
            DeviceError, match=r"no camera is a GenICam camera; found: none. Look at its power and cable"
        ):
            choose((), "", None, "")

    def test_others_are_listed(self):
        with pytest.raises(DeviceError) as refused:
            choose((BLACKFLY, GRASSHOPPER), "", "3", "")
        assert "serial number 3; found: FLIR Blackfly (serial number 1) at 192.168.0.5; PGR" in str(refused.value)
        assert "Correct [camera] serial_number" in str(refused.value)

    def test_two_that_fit_are_one_too_many(self):
        with pytest.raises(DeviceError, match=r"2 cameras are a GenICam camera: .*Set \[camera\] serial_number"):
            choose((BLACKFLY, replace(GRASSHOPPER)), "", None, "")

    def test_one_that_may_not_be_opened_is_the_reason_why_there_is_none(self):
        with pytest.raises(DeviceError, match=r"found: none\. PGR at USB 002:003: no permission"):
            choose((), "", None, "PGR at USB 002:003: no permission")


class TestWithoutAravis:
    def test_what_to_install_is_said(self, monkeypatch: pytest.MonkeyPatch):
        def missing(name: str) -> None:
            raise ModuleNotFoundError(f"No module named {name!r}")

        monkeypatch.setattr(aravis, "import_module", missing)
        with pytest.raises(DriverNotFoundError, match=r"make setup.*gir1.2-aravis-0.8.*halfangle\[genicam\]"):
            DRIVER.open(DRIVER.settings(), {"width": 16, "height": 8}).connect()


class TestUsb:
    @pytest.fixture
    def plug(self, tmp_path: Path) -> Callable[..., Path]:
        def plug(subclass: str = "05") -> Path:
            device, interface = tmp_path / "sys" / "2-1", tmp_path / "sys" / "2-1:1.0"
            node = tmp_path / "dev" / "002" / "005"
            for folder in (device, interface, node.parent):
                folder.mkdir(parents=True)
            words = {"busnum": "2", "devnum": "5", "serial": "16", "manufacturer": "PGR", "product": "Grasshopper3"}
            for name, word in words.items():
                (device / name).write_text(f"{word}\n")
            classes = {"bInterfaceClass": "ef", "bInterfaceSubClass": subclass, "bInterfaceProtocol": "00"}
            for name, word in classes.items():
                (interface / name).write_text(f"{word}\n")
            node.touch()
            return node

        return plug

    def test_a_camera_that_may_be_opened_is_found(self, plug: Callable[..., Path], tmp_path: Path):
        plug()
        (found,) = usb_cameras(tmp_path / "sys", tmp_path / "dev")
        assert (found.state, found.complaint, found.where) == (DeviceState.FOUND, "", "USB 002:005")
        assert found.name == "PGR Grasshopper3 (serial number 16)"

    def test_one_that_may_not_is_named_with_the_rule_that_mends_it(self, plug: Callable[..., Path], tmp_path: Path):
        # Root may open what is there whatever its mode: to everybody, a node that is not there is closed.
        plug().unlink()
        (found,) = usb_cameras(tmp_path / "sys", tmp_path / "dev")
        assert found.state is DeviceState.NO_PERMISSION
        assert "drivers/udev/60-halfangle.rules" in found.complaint

    def test_one_that_another_program_has_is_busy(self, plug: Callable[..., Path], tmp_path: Path):
        plug()
        (tmp_path / "usbfs").mkdir()
        (tmp_path / "sys" / "2-1:1.0" / "driver").symlink_to(tmp_path / "usbfs")
        (found,) = usb_cameras(tmp_path / "sys", tmp_path / "dev")
        assert found.state is DeviceState.BUSY
        assert "End the other program" in found.complaint

    def test_another_kind_of_device_is_no_camera(self, plug: Callable[..., Path], tmp_path: Path):
        plug(subclass="02")
        assert list(usb_cameras(tmp_path / "sys", tmp_path / "dev")) == []

    def test_a_system_without_such_files_has_none(self, tmp_path: Path):
        assert list(usb_cameras(tmp_path / "none", tmp_path / "none")) == []

    def test_the_rule_that_the_message_names_is_shipped(self):
        rules = Path(__file__).parents[3] / UDEV_RULES
        assert "*:ef0500:*" in rules.read_text(encoding="utf-8")
