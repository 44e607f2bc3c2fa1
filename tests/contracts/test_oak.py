import pytest

from drivers.camera import Camera
from drivers.contracts.camera import CameraContract
from tests.drivers.oak.oak_double import OakDouble


class TestOakCamera(CameraContract):
    @pytest.fixture
    def camera(self) -> Camera:
        return OakDouble().camera(longest_exposure_s=0.015)
