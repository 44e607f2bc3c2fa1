"""Captures on the simulated rig, whole and killed."""

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.registry import Devices
from drivers.simulated.clock import VirtualClock
from drivers.simulated.devices import open_simulated
from instrument.config.loading import load_protocol, load_rig
from instrument.config.protocol import ProtocolConfig
from instrument.config.rig import RigConfig
from instrument.session.layout import Status
from instrument.session.session import Session
from protocols.capture.engine import Finish, Progress, capture, resume
from protocols.planning.estimate import FRAME_OVERHEAD, estimate
from tests.verifying import verify_session

RIG = """
name = "small bench"
camera = { driver = "simulated", width = 96, height = 72, focal_length_px = 185.0 }
light = { driver = "simulated", offset_mm = [12.0, 0.0, 0.0], offset_sigma_mm = 3.0 }
stage = { driver = "simulated" }
geometry = { working_distance_mm = 350.0, area_mm = [60.0, 60.0] }
# A resumed rig begins with a cold lamp, as a real one would; without drift that leaves no trace.
simulation = { seed = 3, warm_up_drift = 0.0, distortion = [-0.05, 0.0] }
"""
PROTOCOL = """
name = "four views"
bracket = { exposure_times_s = [0.002, 0.02], darks = 2 }
rings = [{ tilt_deg = 0.0, count = 1 }, { tilt_deg = 25.0, count = 3, start_deg = 10.0 }]
"""

KILLED_CAPTURE = """
import os, signal, sys
from instrument.session import layout
from instrument.config.loading import load_protocol, load_rig
from instrument.recording.recorder import Recorder
from protocols.capture.engine import Finish, Progress, capture, resume

write, doomed = Recorder._write, getattr(layout, sys.argv[4])

def write_and_die(self, field, value, at=()):
    if field is doomed and (at[0] if isinstance(at, tuple) and at else at) == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    write(self, field, value, at)

Recorder._write = write_and_die
capture(load_rig(sys.argv[1]), load_protocol(sys.argv[2]), sys.argv[3])
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    (folder / "rig.toml").write_text(RIG)
    (folder / "protocol.toml").write_text(PROTOCOL)
    return folder


@pytest.fixture(scope="module")
def rig(folder: Path) -> RigConfig:
    return load_rig(folder / "rig.toml")


@pytest.fixture(scope="module")
def protocol(folder: Path) -> ProtocolConfig:
    return load_protocol(folder / "protocol.toml")


@pytest.fixture(scope="module")
def whole(folder: Path, rig: RigConfig, protocol: ProtocolConfig) -> Path:
    path = folder / "whole.h5"
    assert capture(rig, protocol, path).finish is Finish.COMPLETE
    return path


def assert_same_data(first: Path, second: Path) -> None:
    with Session(first) as one, Session(second) as two:
        assert one.digest() == two.digest()
        assert one.status is two.status is Status.COMPLETE
        for i_pose in range(one.n_poses):
            np.testing.assert_array_equal(one.frames(i_pose), two.frames(i_pose))
        np.testing.assert_array_equal(one.dark, two.dark)
        np.testing.assert_array_equal(one.dark_variance, two.dark_variance)


def test_a_capture_on_the_simulated_rig_is_complete_and_verified(whole: Path) -> None:
    assert list(verify_session(whole)) == []
    with Session(whole) as session:
        assert session.dark is not None
        assert abs(session.dark.mean() - session.camera.black_level) < 1
        assert session.frames(0)[1].mean() > session.frames(0)[0].mean() > session.camera.black_level


def test_a_capture_interrupted_at_a_pose_resumes_to_the_same_data(
    tmp_path: Path, rig: RigConfig, protocol: ProtocolConfig, whole: Path
) -> None:
    def stop_at_third(progress: Progress) -> None:
        if progress.message.startswith("pose 3") and not stopped:
            stopped.append(True)
            raise KeyboardInterrupt

    stopped: list[bool] = []
    outcome = capture(rig, protocol, tmp_path / "s.h5", stop_at_third)
    assert (outcome.finish, outcome.n_complete) == (Finish.PAUSED, 2)
    assert resume(tmp_path / "s.h5").finish is Finish.COMPLETE
    assert_same_data(tmp_path / "s.h5", whole)


@pytest.mark.parametrize("moment", ["IMAGES", "POSE_COMPLETE"])
def test_a_capture_killed_while_it_writes_a_pose_resumes_to_the_same_data(
    folder: Path, tmp_path: Path, whole: Path, moment: str
) -> None:
    path = tmp_path / "killed.h5"
    arguments = [str(folder / "rig.toml"), str(folder / "protocol.toml"), str(path), moment]
    done = subprocess.run([sys.executable, "-c", KILLED_CAPTURE, *arguments], check=False)
    assert done.returncode == -9
    with Session(path) as session:
        assert session.status is Status.RECORDING
        assert session.pose_complete.tolist() == [True, True, False, False]
    assert list(verify_session(path)) == []
    assert resume(path).finish is Finish.COMPLETE
    assert list(verify_session(path)) == []
    assert_same_data(path, whole)


def test_the_estimated_time_is_within_a_tenth_of_the_simulated_one(
    tmp_path: Path, rig: RigConfig, protocol: ProtocolConfig
) -> None:
    def timed(config: Mapping[str, Any]) -> Devices:
        _, *devices = open_simulated(config, clock)
        return tuple(devices)

    clock = VirtualClock()
    capture(rig, protocol, tmp_path / "s.h5", devices=timed)
    outlook = estimate(rig, protocol)
    overhead = FRAME_OVERHEAD * (outlook.n_frames + outlook.n_poses + outlook.n_darks)
    assert outlook.seconds - overhead == pytest.approx(clock.now(), rel=0.1)
