"""`halfangle capture` through three real drivers at once: GenICam over the network, GRBL on a port, SCPI over USB."""

import errno
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
import serial

from instrument.session.session import Session
from tests.drivers.genicam.fake_genicam import SERIAL_NUMBER, FakeGenicam, SecondClient
from tests.drivers.genicam.lit_genicam import BLACK, RATE
from tests.drivers.grbl.grbl_double import GrblDouble
from tests.drivers.lights.serial_light_double import SerialLightDouble
from tests.end_to_end.real_rig import RealRig, real_rig


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[tuple[RealRig, FakeGenicam]]:
    with real_rig(tmp_path) as bench:
        yield bench


@pytest.fixture
def rig(bench: tuple[RealRig, FakeGenicam]) -> RealRig:
    return bench[0]


def test_three_real_drivers_capture_a_session_that_verifies(rig: RealRig):
    done = rig.capture()
    assert done.returncode == 0, done.stdout + done.stderr
    verified = rig.run("session", "verify", rig.session)
    assert verified.returncode == 0, verified.stdout
    assert "every check passed; 3 of 3 poses are good" in verified.stdout
    assert rig.light_level == 0.0
    with Session(rig.session) as session:
        assert session.camera.model == "Fake"
        assert session.serial_numbers == {"camera": SERIAL_NUMBER, "light": "M00000001", "stage": "bench 7"}
        for time_, counts in zip(session.exposure_times, session.frames(0), strict=True):
            # The middle of the picture, where the sheet is as bright as it gets.
            assert np.mean(counts[30:34, 46:50]) == pytest.approx(BLACK + RATE * time_, rel=0.05)


def test_the_same_rig_passes_its_check_and_its_devices_are_told(rig: RealRig):
    unmoved = rig.run("rig", "check", rig.rig)
    assert unmoved.returncode == 3, unmoved.stdout
    assert "not homed since it was connected" in unmoved.stdout
    checked = rig.run("rig", "check", rig.rig, "--home")
    assert checked.returncode == 0, checked.stdout
    for text in ("Thorlabs DC2200", "GRBL 1.1h", "Aravis Fake", "gain 0 (0 to 10)", "sees the light"):
        assert text in checked.stdout
    found = rig.run("devices").stdout
    assert 'camera, driver = "genicam"' in found
    assert 'light, driver = "scpi"' in found


Breaking = Callable[[RealRig, FakeGenicam], AbstractContextManager[None]]


@contextmanager
def port_open_elsewhere(rig: RealRig, _: FakeGenicam) -> Iterator[None]:
    with serial.Serial(rig.stage.port, exclusive=True):
        yield


@contextmanager
def other_device_on_the_port(rig: RealRig, _: FakeGenicam) -> Iterator[None]:
    other = SerialLightDouble()
    rig.change(f'"{rig.port}"', f'"{other.port}"')
    yield
    other.unplug()


@contextmanager
def camera_in_use(_: RealRig, __: FakeGenicam) -> Iterator[None]:
    with closing(SecondClient(heartbeat_ms=60_000)):
        yield


def at_once(act: Callable[[RealRig, FakeGenicam], object]) -> Breaking:
    @contextmanager
    def breaking(rig: RealRig, camera: FakeGenicam) -> Iterator[None]:
        act(rig, camera)
        yield

    return breaking


no_camera = at_once(lambda _, camera: camera.kill())
camera_swapped = at_once(lambda rig, _: rig.change("width = 96", 'serial_number = "X7"\nwidth = 96'))
no_light = at_once(lambda rig, _: rig.unplug_light())
light_forbidden = at_once(lambda rig, _: rig.plug_light_in(open_error=errno.EACCES))
light_busy = at_once(lambda rig, _: rig.plug_light_in(claim_error=errno.EBUSY))
other_light = at_once(lambda rig, _: rig.plug_light_in(new={"identity": "Acme,PS-1,7,1.0"}))
stage_forbidden = at_once(lambda rig, _: rig.forbid_stage())
no_port = at_once(lambda rig, _: rig.change(f'"{rig.port}"', '"/dev/ttyACM77"'))
other_travel = at_once(lambda rig, _: rig.change("scale = -1.0", "scale = -9.0"))


@pytest.mark.parametrize(
    ("breaking", "message"),
    [
        pytest.param(no_light, "no USB device 1313:80c8; found: no USB device at all", id="no light"),
        pytest.param(no_port, "cannot open /dev/ttyACM77. There is no such port", id="no stage"),
        pytest.param(
            stage_forbidden, "You have no permission. Join the group that owns the port", id="stage forbidden"
        ),
        pytest.param(camera_swapped, "has serial number T", id="another camera"),
        *(
            pytest.param(breaking, message, id=id_, marks=pytest.mark.slow)
            for breaking, message, id_ in (
                (no_camera, "no camera is a GenICam camera at 127.0.0.1; found: none", "no camera"),
                (camera_in_use, "is in use by another program", "camera in use"),
                (light_forbidden, "no permission to open the USB device", "light forbidden"),
                (light_busy, "is in use by another process", "light in use"),
                (other_light, "is 'Acme,PS-1,7,1.0'; expected was a DC2200", "another light"),
                (port_open_elsewhere, "Another program uses the port (process", "stage in use"),
                (other_device_on_the_port, "is no GRBL 1.1; it sent 'ERR unknown'", "another device on the port"),
                (other_travel, "does not fit rig.toml", "a stage that is set up otherwise"),
            )
        ),
    ],
)
def test_a_device_that_cannot_be_used_is_one_message_and_nothing_is_left_open_or_lit(
    bench: tuple[RealRig, FakeGenicam], breaking: Breaking, message: str
):
    rig, camera = bench
    with breaking(rig, camera):
        done = rig.capture()
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("halfangle: ")
    assert len(done.stderr.splitlines()) == 1
    assert message in done.stderr
    assert not rig.session.exists()
    # The controller may have shone before, as its panel told it; nobody told it to now.
    assert rig.n_flashes <= 1
    Path(rig.stage.port).chmod(0o600)
    with serial.Serial(rig.stage.port, exclusive=True):
        pass


def test_all_that_cannot_be_used_is_said_at_once(bench: tuple[RealRig, FakeGenicam]):
    rig, camera = bench
    camera.kill()
    rig.unplug_light()
    rig.change(f'"{rig.port}"', '"/dev/ttyACM77"')
    done = rig.capture()
    assert done.returncode == 1
    assert done.stderr.startswith("halfangle: 3 devices cannot be used:\n")
    assert [line.split(":")[0].strip() for line in done.stderr.splitlines()[1:]] == ["light", "stage", "camera"]


@pytest.mark.slow
@pytest.mark.parametrize("gone", ["camera", "light", "stage"])
def test_a_device_that_goes_in_the_middle_ends_the_capture_and_it_goes_on_when_that_is_back(
    bench: tuple[RealRig, FakeGenicam], gone: str
):
    rig, camera = bench
    process = rig.start("capture", rig.protocol, "--rig", rig.rig, "-o", rig.session)
    while rig.light_level == 0.0 or not rig.session.exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.005)
    {"camera": camera.kill, "light": rig.unplug_light, "stage": rig.stage.unplug}[gone]()
    out, err = process.communicate(timeout=120)
    said = out + err
    assert "a device is gone and did not come back: " in said
    if gone == "light":
        # It shone when it was last heard, and nobody knows more.
        assert process.returncode == 4
        assert "NOT SAFE: light off failed: the light is gone. It does not answer and may still shine" in said
        assert "The light is off" not in said
    else:
        assert (process.returncode, err) == (1, "")
        assert "The light is off" in out
    # The double of the light ends with the process that has its port; a controller ends its pulse by itself.
    assert rig.light_level == 0.0 or gone == "light"
    with GrblDouble() as other_stage:
        {"camera": camera.start, "light": rig.plug_light_in, "stage": lambda: rig.plug_stage_in(other_stage)}[gone]()
        assert rig.run("resume", rig.session).returncode == 0
    assert rig.run("session", "verify", rig.session).returncode == 0
    assert rig.light_level == 0.0
