"""A capture written out as DNG files and imported again, on rigs with a near and a far light: nothing is lost.

And what the simulation was given comes back within the sigma that the calibration states.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.registration.stack_file import read_stack
from analysis.results.result_file import read_result
from benchmarks.common.simulated import EXAMPLES
from drivers.simulated.world import World
from instrument.config.loading import load_protocol, load_rig
from instrument.config.rig import RigConfig
from instrument.session import layout
from instrument.session.session import Session
from protocols.capture.engine import capture
from tests.end_to_end.test_chain import run

pytestmark = pytest.mark.slow

RIGS = {
    "light at 12 mm": {"light_offset_mm": (12.6, -1.1, 0.4), "distortion": (-0.08, 0.05), "warm_up_drift": 0.02},
    "light at 40 mm": {"light_offset_mm": (40.8, -1.6, 0.5), "distortion": (-0.15, 0.08), "warm_up_drift": 0.05},
}


@dataclass(frozen=True)
class Chain:
    """Files of one rig: of its own session (``s``) and of the one that was written out and imported (``i``)."""

    folder: Path
    rig: RigConfig

    def figures(self) -> dict[str, object]:
        return json.loads((self.folder / "s.json").read_text())


@pytest.fixture(scope="module", params=RIGS, ids=lambda name: name.replace(" ", "_"))
def chain(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Chain:
    folder = tmp_path_factory.mktemp("import")
    rig = load_rig(EXAMPLES / "simulated.toml")
    truth = {"seed": 11, "power_jitter": 0.02, **RIGS[request.param]}
    ruler = (float(round(truth["light_offset_mm"][0])), 0.0, 0.0)
    rig = rig.model_copy(
        update={
            "simulation": rig.simulation.model_copy(update=truth),
            "light": rig.light.model_copy(update={"offset_mm": ruler}),
        }
    )
    capture(rig, load_protocol(EXAMPLES / "quick_sweep.toml"), folder / "s.h5")
    assert run("session", "export", folder / "s.h5", "-o", folder / "dng") == 0
    assert run("import", folder / "dng", "-o", folder / "i.h5") == 0
    for name in ("s", "i"):
        stack = folder / f"{name}.stack.h5"
        arguments = (folder / f"{name}.h5", "-o", stack, "--pitch", "0.5", "-q", "--json", folder / f"{name}.json")
        assert run("calibrate", *arguments) == 0
        assert run("reconstruct", stack, "-o", folder / f"{name}.result.h5", "-q", "--left-out", "0") == 0
    return Chain(folder, rig)


def test_the_import_gives_the_same_normals_as_the_session_itself(chain: Chain) -> None:
    ours, imported = (read_result(chain.folder / f"{name}.result.h5").normals for name in ("s", "i"))
    assert np.nanmean(angular_error_deg(imported, ours)) < 0.05


def test_lens_and_light_come_back_within_their_stated_sigmas(chain: Chain) -> None:
    world, found = World.from_rig(chain.rig.model_dump(exclude_none=True)), chain.figures()
    sigma, K, truth = found["sigma_px"], world.camera_matrix, chain.rig.simulation
    z = [
        (found["fy_px"] - K[1, 1]) / sigma["f"],
        (found["cx_px"] - K[0, 2]) / sigma["cx"],
        (found["cy_px"] - K[1, 2]) / sigma["cy"],
        (found["distortion"][0] - truth.distortion[0]) / sigma["k1"],
        (found["distortion"][1] - truth.distortion[1]) / sigma["k2"],
        *((np.array(found["light_offset_mm"]) - truth.light_offset_mm) / found["light_offset_sigma_mm"]),
    ]
    z = np.abs(z)
    assert np.all(z < 3.0), z
    assert np.mean(z < 1.0) > 0.5, z


def test_each_views_power_comes_back_with_the_drift_of_the_warming_lamp(chain: Chain) -> None:
    """Seen on white in the centre of the plane, since what is known of the light's place moves the powers with it."""
    world = World.from_rig(chain.rig.model_dump(exclude_none=True))
    stack = read_stack(chain.folder / "s.stack.h5")
    with Session(chain.folder / "s.h5") as session, h5py.File(session.path, locking=False) as file:
        places = [{axis: float(v[i]) for axis, v in session.axis_values.items()} for i in range(stack.n_views)]
        lamp = file[layout.MONITOR.path][...].mean(axis=1)
    power = lamp * [world.light_power(place) for place in places]
    light = np.stack([world.light_in_sample(place) for place in places])
    error = np.log(stack.light_power * _on_white(stack.light_position) / (power * _on_white(light)))
    z = (error - error.mean()) / stack.light_power_sigma
    assert np.sqrt(np.mean(z**2)) < 2.0
    assert np.std(error) < 0.002


def _on_white(light: np.ndarray) -> np.ndarray:
    return light[:, 2] / np.linalg.norm(light, axis=1) ** 3
