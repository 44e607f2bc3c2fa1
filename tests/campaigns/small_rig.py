"""A capture small enough to be repeated hundreds of times, run in processes of its own that may be killed."""

from __future__ import annotations

import multiprocessing
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np

from instrument.config.messages import validate
from instrument.config.protocol import ProtocolConfig
from instrument.config.rig import RigConfig
from instrument.session.layout import Status
from instrument.session.session import Session
from protocols.capture.engine import capture, resume

RIG = {
    "name": "small bench",
    "camera": {"driver": "simulated", "width": 48, "height": 36, "focal_length_px": 90.0},
    "light": {"driver": "simulated", "offset_mm": [12.0, 0.0, 0.0], "offset_sigma_mm": 3.0, "warm_up_s": 60.0},
    "stage": {"driver": "simulated"},
    "geometry": {"working_distance_mm": 350.0, "area_mm": [60.0, 60.0]},
    "simulation": {"seed": 3, "warm_up_drift": 0.03, "warm_up_s": 60.0, "distortion": [-0.05, 0.0]},
}
PROTOCOL = {
    "name": "six views",
    "bracket": {"exposure_times_s": [0.002, 0.01, 0.05], "darks": 2},
    "rings": [{"tilt_deg": 0.0, "count": 1}, {"tilt_deg": 25.0, "count": 5, "start_deg": 10.0}],
}


def rig_config(name: str = "small bench") -> RigConfig:
    rig = validate(RigConfig, {**RIG, "name": name})
    # What a light does after it is warm is nothing: a resumed capture sees the same power as a whole one.
    return rig.model_copy(update={"light": rig.light.model_copy(update={"steady_per_minute": 1e-4})})


def protocol_config() -> ProtocolConfig:
    return validate(ProtocolConfig, PROTOCOL)


def run_capture(path: str, name: str = "small bench") -> None:
    capture(rig_config(name), protocol_config(), path)


def run_resume(path: str) -> None:
    resume(path)


def processes() -> ForkServerContext:
    """Return what starts processes in milliseconds: they are copies of one that has imported everything."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.faults.bench", "tests.campaigns.warm"])
    return context


def ended(process: BaseProcess, seconds: float = 60.0) -> int | None:
    """Wait for a process and return its exit code."""
    process.join(seconds)
    return process.exitcode


def content(path: Path) -> dict[str, object]:
    """What must not depend on when and how often a capture was interrupted."""
    with Session(path) as session:
        assert session.status is Status.COMPLETE
        assert session.dark is not None
        assert session.dark_variance is not None
        return {
            "frames": [session.frames(i).tobytes() for i in range(session.n_poses)],
            "dark": session.dark.tobytes() + session.dark_variance.tobytes(),
            "digest": session.digest(),
            "axes": {name: values.tolist() for name, values in session.axis_values.items()},
            "exposures": session.exposure_readback.tolist(),
            "valid": bool(np.all(session.frame_ok)),
        }
