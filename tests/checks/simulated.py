"""One small session of the simulated rig, from the capture to the result's file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.register import register
from analysis.calibration.session import Calibration
from analysis.evaluation.scoring import score
from analysis.radiometry.frames import MergedFrames
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.registration.stack import Stack
from analysis.registration.stack_file import read_stack
from analysis.results.result import result_of
from analysis.results.result_file import write_result
from drivers.simulated.rendering.truth import Truth
from drivers.simulated.world import World
from instrument.config.loading import load_protocol, load_rig
from instrument.session.session import Session
from protocols.capture.engine import capture

EXAMPLE = Path(__file__).parents[2] / "examples" / "simulated.toml"
PITCH_MM = 0.75
PROTOCOL = """
name = "few poses"
sample = "relief"
[bracket]
exposure_times_s = [0.002, 0.01, 0.05]
darks = 2
[[rings]]
tilt_deg = 0.0
count = 1
[[rings]]
tilt_deg = 20.0
count = 5
[[rings]]
tilt_deg = 42.0
count = 7
start_deg = 20.0
"""


@dataclass(frozen=True)
class Simulated:
    """A session and what came of it.

    Attributes
    ----------
    session : Session
    frames : MergedFrames
    calibration : Calibration
    stack, reconstruction : Stack, Reconstruction
    stack_file, result_file : Path
    world : World
        The truth.
    """

    session: Session
    frames: MergedFrames
    calibration: Calibration
    stack: Stack
    reconstruction: Reconstruction
    stack_file: Path
    result_file: Path
    world: World

    @property
    def truth(self) -> Truth:
        """The sample at the pixels of the stack."""
        points = self.stack.grid.points()
        return self.world.truth(points[..., 0], points[..., 1])

    def position(self, view: int) -> dict[str, float]:
        """Return what the stage read in a view."""
        i_pose = self.calibration.i_pose[view]
        return {name: float(values[i_pose]) for name, values in self.session.axis_values.items()}

    def radiance(self, view: int) -> NDArray[np.float64]:
        """Return the true radiance of a view for light of power 1, shape (H, W, 3)."""
        points, position = self.stack.grid.points(), self.position(view)
        camera, light = self.world.camera_in_sample(position), self.world.light_in_sample(position)
        return self.world.radiance_on_area(points[..., 0], points[..., 1], camera, light)


@contextmanager
def simulate(folder: Path) -> Iterator[Simulated]:
    """Capture, calibrate, register and reconstruct in `folder`; the light's power jitters by 2 %."""
    rig_file, protocol_file = folder / "rig.toml", folder / "few.toml"
    text = EXAMPLE.read_text(encoding="utf-8")
    assert "power_jitter = 0.01" in text
    rig_file.write_text(text.replace("power_jitter = 0.01", "power_jitter = 0.02"), encoding="utf-8")
    protocol_file.write_text(PROTOCOL, encoding="utf-8")
    rig = load_rig(rig_file)
    capture(rig, load_protocol(protocol_file), folder / "s.h5")
    with Session(folder / "s.h5") as session:
        calibration = register(session, folder / "area.stack.h5", PITCH_MM)
        stack = read_stack(folder / "area.stack.h5")
        # Pixels on their own: a palette takes a minute and is not what is checked.
        result = reconstruct(stack, Options(palette="off"))
        write_result(folder / "r.h5", result_of(result, [], score(result, n_held_out=0), None))
        yield Simulated(
            session=session,
            frames=MergedFrames(session),
            calibration=calibration,
            stack=stack,
            reconstruction=result,
            stack_file=folder / "area.stack.h5",
            result_file=folder / "r.h5",
            world=World.from_rig(rig.model_dump(exclude_none=True)),
        )
