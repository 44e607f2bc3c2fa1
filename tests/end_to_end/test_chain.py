"""The whole chain on the simulated rig: capture, calibrate, reconstruct, each by its command."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from analysis.registration.stack import Stack
from analysis.registration.stack_file import read_stack, write_truth
from analysis.results.result_file import read_result
from benchmarks.common.simulated import EXAMPLES, truth_of
from cli.main import main
from drivers.simulated.world import World
from instrument.config.loading import load_rig

# A minute of its own; `make test` has the same way, smaller, in tests/checks.
pytestmark = pytest.mark.slow

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
tilt_deg = 15.0
count = 5
[[rings]]
tilt_deg = 32.0
count = 6
start_deg = 20.0
[[rings]]
tilt_deg = 45.0
count = 6
"""


def run(*arguments: str | Path) -> int:
    """Run `halfangle` and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a session of 18 poses, its stack with the truth, and its result."""
    made = tmp_path_factory.mktemp("chain")
    (made / "few.toml").write_text(PROTOCOL)
    assert run("capture", made / "few.toml", "--rig", EXAMPLES / "simulated.toml", "-o", made / "s.h5") == 0
    arguments = (made / "s.h5", "-o", made / "area.stack.h5", "--pitch", "0.6", "-q", "--json", made / "cal.json")
    arguments = (*arguments, "--report", made / "cal.html")
    assert run("calibrate", *arguments) == 0
    rig = load_rig(EXAMPLES / "simulated.toml")
    write_truth(made / "area.stack.h5", truth_of(rig, read_stack(made / "area.stack.h5").grid))
    arguments = (made / "area.stack.h5", "-o", made / "r.h5", "-q", "--json", made / "r.json", "--left-out", "3")
    assert run("reconstruct", *arguments) == 0
    return made


@pytest.fixture(scope="module")
def stack(folder: Path) -> Stack:
    return read_stack(folder / "area.stack.h5")


@pytest.fixture(scope="module")
def world() -> World:
    return World.from_rig(load_rig(EXAMPLES / "simulated.toml").model_dump(exclude_none=True))


def test_the_session_verifies(folder: Path) -> None:
    assert run("session", "verify", folder / "s.h5") == 0


def test_the_page_of_the_calibration_shows_the_worst_view_and_where_the_camera_stood(folder: Path) -> None:
    page = (folder / "cal.html").read_text()
    assert page.count("data:image/png;base64,") == 10
    for text in ("The worst view, pose", "Where the camera stood", "stage", "drift of the light", "light offset x"):
        assert text in page


def test_calibration_finds_what_the_simulation_was_given(folder: Path, world: World) -> None:
    found = json.loads((folder / "cal.json").read_text())
    given = tomllib.loads((EXAMPLES / "simulated.toml").read_text())["simulation"]
    assert found["corner_rms_px"] < 0.02
    assert abs(found["fx_px"] - world.camera_matrix[0, 0]) < 3.0 * found["sigma_px"]["f"]
    assert found["white_rms"] < 0.01
    assert found["verdict"]["FAIL"] == 0, found["checks"]
    off = np.subtract(found["light_offset_mm"][:2], given["light_offset_mm"][:2])
    assert np.all(np.abs(off) < 3.0 * np.array(found["light_offset_sigma_mm"][:2]))


def test_calibration_says_which_error_reaches_the_normals_most(folder: Path) -> None:
    budget = json.loads((folder / "cal.json").read_text())["error_budget_deg"]
    assert set(budget) == {"image noise", "light power", "light position", "registration", "fall-off"}
    assert 0.0 < max(budget.values()) < 1.0


def test_every_camera_position_is_near_the_true_one(stack: Stack, world: World) -> None:
    tilts = [(0.0, 0.0), *((15.0, 72.0 * k) for k in range(5)), *((32.0, 20.0 + 60.0 * k) for k in range(6))]
    true_place = [world.camera_in_sample({"tilt": tilt, "turn": turn}) for tilt, turn in tilts]
    np.testing.assert_allclose(stack.camera_position[: len(tilts)], true_place, atol=0.05)
    true = world.radiance_on_area(*_grid(stack), stack.camera_position[0], stack.light_position[0])
    ratio = stack.radiance[0] / true / stack.light_power[0]
    assert np.nanpercentile(ratio / np.nanmedian(ratio, axis=(0, 1)), 5) > 0.8


def _grid(stack: Stack) -> tuple[np.ndarray, np.ndarray]:
    points = stack.grid.points()
    return points[..., 0], points[..., 1]


def test_normals_and_depth_come_out_near_the_truth(folder: Path) -> None:
    figures = json.loads((folder / "r.json").read_text())
    assert figures["normal_error_deg"]["median"] < 0.6
    assert figures["normal_error_deg"]["mean"] < 1.2
    assert figures["depth_rmse_mm"] < 0.08
    assert figures["n_unsolved"] == 0


def test_views_left_out_are_predicted_better_than_by_a_lambertian_fit(folder: Path) -> None:
    left_out = json.loads((folder / "r.json").read_text())["left_out"]
    assert np.median([view["glossy_gain_db"] for view in left_out]) > 6.0


def test_an_embossed_letter_stays_convex_and_is_not_mirrored(folder: Path, stack: Stack) -> None:
    result = read_result(folder / "r.h5")
    truth = stack.truth
    assert truth is not None
    ours = np.corrcoef(result.depth.ravel(), truth.depth.ravel())[0, 1]
    mirrored = np.corrcoef(result.depth[:, ::-1].ravel(), truth.depth.ravel())[0, 1]
    # 18 poses and pixels of 0.6 mm give 0.92; an inside-out relief would be negative.
    assert ours > 0.85
    assert mirrored < 0.5


def test_a_light_taken_as_collocated_costs_accuracy(stack: Stack) -> None:
    assert stack.truth is not None
    few = replace(stack, radiance=stack.radiance[:, ::3, ::3], variance=None, saturated=None, pixels="independent",
                  pixel_pitch=3 * stack.pixel_pitch, truth=None)  # fmt: skip
    truth = stack.truth.normals[::3, ::3]
    errors = {
        light: np.nanmedian(angular_error_deg(reconstruct(few, Options(light=light)).normals, truth))
        for light in ("given", "collocated")
    }
    assert errors["collocated"] > 1.5 * errors["given"]


def test_a_novel_view_with_a_light_far_from_the_lens_is_predicted(folder: Path, stack: Stack, world: World) -> None:
    camera, light = np.array([40.0, -30.0, 340.0]), np.array([-60.0, 50.0, 330.0])
    true = world.radiance_on_area(*_grid(stack), camera, light)
    predicted = read_result(folder / "r.h5").render(camera, light)
    scale = np.nansum(true * predicted) / np.nansum(predicted**2)
    assert np.sqrt(np.nanmean((scale * predicted - true) ** 2) / np.nanmean(true**2)) < 0.35
