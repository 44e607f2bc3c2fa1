from collections.abc import Iterator

import pytest

from drivers.camera import Camera
from drivers.contracts.camera import CameraContract
from tests.drivers.genicam.fake_genicam import FakeGenicam


class TestGenicamCamera(CameraContract):
    @pytest.fixture
    def camera(self) -> Iterator[Camera]:
        with FakeGenicam() as fake:
            camera = fake.camera()
            yield camera
            camera.disconnect()
