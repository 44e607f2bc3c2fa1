"""What every camera keeps, simulated or not."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from drivers.camera import Camera, CameraDescription, Frame
from drivers.errors import DeviceError, DeviceLimitError


class CameraContract:
    """Subclass it, and give a fixture `camera` that is not yet connected."""

    @pytest.fixture
    def connected(self, camera: Camera) -> Iterator[Camera]:
        camera.connect()
        yield camera
        camera.disconnect()

    def test_satisfies_the_protocol(self, camera: Camera) -> None:
        assert isinstance(camera, Camera)

    def test_refuses_to_work_before_it_is_connected(self, camera: Camera) -> None:
        for act in (camera.describe, camera.trigger, lambda: camera.set_exposure_time(0.01)):
            with pytest.raises(DeviceError, match="not connected"):
                act()

    def test_connects_and_disconnects_twice_without_complaint(self, camera: Camera) -> None:
        camera.disconnect()
        camera.connect()
        camera.connect()
        camera.disconnect()
        camera.disconnect()
        with pytest.raises(DeviceError):
            camera.trigger()

    def test_can_be_stopped_at_any_time(self, camera: Camera) -> None:
        camera.stop()
        camera.connect()
        camera.stop()
        assert isinstance(camera.trigger(), Frame)
        camera.disconnect()

    def test_delivers_frames_as_described(self, connected: Camera) -> None:
        description, frame = connected.describe(), connected.trigger()
        assert isinstance(description, CameraDescription)
        assert frame.counts.dtype == np.uint16
        assert frame.counts.shape == (description.height, description.width)
        assert frame.counts.max() <= description.saturation_level <= 2**description.bit_depth - 1

    def test_counts_its_triggers(self, connected: Camera) -> None:
        first = connected.trigger().sequence_number
        assert [connected.trigger().sequence_number for _ in range(3)] == [first + 1, first + 2, first + 3]

    def test_reports_the_exposure_time_it_was_set_to(self, connected: Camera) -> None:
        read_back = connected.set_exposure_time(0.0123)
        assert read_back == pytest.approx(0.0123, rel=0.01)
        assert connected.trigger().exposure_time == read_back

    def test_takes_the_ends_of_its_exposure_range(self, connected: Camera) -> None:
        limits = connected.describe().exposure_time_limits
        for end in (limits.low, limits.high):
            assert connected.set_exposure_time(end) == pytest.approx(end)

    @pytest.mark.parametrize("factor", [2.0, -1.0, float("nan")])
    def test_refuses_an_exposure_time_outside_its_range(self, connected: Camera, factor: float) -> None:
        before = connected.set_exposure_time(0.01)
        with pytest.raises(DeviceLimitError, match=r"exposure_time is .* allowed is"):
            connected.set_exposure_time(factor * connected.describe().exposure_time_limits.high)
        assert connected.trigger().exposure_time == before
