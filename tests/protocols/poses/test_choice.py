from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.limits import Limits
from drivers.simulated.stage import SimulatedStage
from drivers.simulated.world import World
from drivers.stage import AxisDescription
from instrument.config.loading import load_protocol, load_rig
from instrument.config.protocol import ChosenConfig
from instrument.config.rig import RigConfig
from instrument.files.validation import InvalidInputError
from protocols.planning.plan import Plan
from protocols.poses.choice import choose_poses
from protocols.poses.criterion import Criterion
from protocols.poses.nominal_geometry import lens_and_light

EXAMPLES = Path(__file__).parents[3] / "examples"
TILT = AxisDescription("tilt", "rotation", Limits(-65.0, 65.0, "deg"), 0.01, (1.0, 0.0, 0.0))
TURN = AxisDescription("turn", "rotation", Limits(-360.0, 360.0, "deg"), 0.01, (0.0, 0.0, 1.0))
AXES = (TILT, TURN)
CHOICE = ChosenConfig(count=8)


@pytest.fixture(scope="module")
def rig() -> RigConfig:
    return load_rig(EXAMPLES / "simulated.toml")


@pytest.fixture(scope="module")
def chosen(rig: RigConfig) -> tuple[dict[str, float], ...]:
    return choose_poses(rig, AXES, CHOICE)


def stage_axes(world: World) -> tuple[AxisDescription, ...]:
    stage = SimulatedStage(world)
    stage.connect()
    return stage.describe().axes


def expected_error(rig: RigConfig, poses: list[dict[str, float]], choice: ChosenConfig = CHOICE) -> float:
    return Criterion.of(rig, AXES, choice, poses).value(range(len(poses)))


def rings(*tilt_and_count: tuple[float, int]) -> list[dict[str, float]]:
    return [{"tilt": tilt, "turn": 360.0 * i / n + tilt} for tilt, n in tilt_and_count for i in range(n)]


def random_poses(rng: np.random.Generator, count: int) -> list[dict[str, float]]:
    return [{"tilt": rng.uniform(0.0, 60.0), "turn": rng.uniform(-180.0, 180.0)} for _ in range(count)]


def directions(rig: RigConfig, poses: list[dict[str, float]]) -> NDArray[np.float64]:
    lens, _ = lens_and_light(rig, AXES, poses)
    return np.asarray(lens / np.linalg.norm(lens, axis=1, keepdims=True))


def test_the_example_asks_for_25_chosen_poses() -> None:
    protocol = load_protocol(EXAMPLES / "chosen_poses.toml")
    assert protocol.chosen is not None
    assert protocol.chosen.count == 25
    assert protocol.chosen == ChosenConfig(count=25)  # the comments state the defaults


def test_the_nominal_geometry_is_that_of_a_simulated_rig_without_errors(rig: RigConfig) -> None:
    exact = rig.simulation.model_copy(
        update={
            "mount_rotation_deg": 0.0,
            "mount_translation_mm": 0.0,
            "axis_error_deg": 0.0,
            "light_offset_mm": rig.light.offset_mm,
        }
    )
    settings = rig.model_copy(update={"simulation": exact}).model_dump(exclude_none=True)
    world = World.from_rig(settings)
    axes = stage_axes(world)
    assert [axis.name for axis in axes] == ["tilt", "turn"]
    poses = random_poses(np.random.default_rng(0), 20)
    lens, light = lens_and_light(rig, axes, poses)
    np.testing.assert_allclose(lens, [world.camera_in_sample(pose) for pose in poses], atol=1e-9)
    np.testing.assert_allclose(light, [world.light_in_sample(pose) for pose in poses], atol=1e-9)


def test_a_sample_that_travels_sees_the_lens_move_the_other_way(rig: RigConfig) -> None:
    slide = AxisDescription("x", "translation", Limits(-5.0, 5.0, "mm"), 0.01, (1.0, 0.0, 0.0))
    (still, moved), _ = lens_and_light(rig, (*AXES, slide), [{}, {"x": 2.0}])
    np.testing.assert_allclose(moved - still, [-2.0, 0.0, 0.0], atol=1e-12)


def test_one_more_pose_never_raises_the_expected_error(rig: RigConfig) -> None:
    rng = np.random.default_rng(1)
    poses = random_poses(rng, 30)
    criterion = Criterion.of(rig, AXES, CHOICE, poses)
    values = [criterion.value(range(n)) for n in range(1, 31)]
    assert (np.diff(values) <= 1e-12).all()
    assert values[-1] < 0.5 * values[0]


def test_the_error_with_one_more_view_equals_that_computed_anew(rig: RigConfig) -> None:
    criterion = Criterion.of(rig, AXES, CHOICE, random_poses(np.random.default_rng(2), 10))
    anew = [criterion.value([0, 1, 2, 3, i]) for i in range(10)]
    np.testing.assert_allclose(criterion.with_one_more([0, 1, 2, 3]), anew, rtol=1e-9)


def test_the_choice_beats_random_poses_and_rings_of_the_same_number(
    rig: RigConfig, chosen: tuple[dict[str, float], ...]
) -> None:
    rng = np.random.default_rng(3)
    ours = expected_error(rig, list(chosen))
    at_random = [expected_error(rig, random_poses(rng, 8)) for _ in range(20)]
    on_rings = [expected_error(rig, rings((15.0, 3), (tilt, 5))) for tilt in (30.0, 45.0, 50.0, 60.0)]
    assert ours < 0.85 * min(at_random)
    assert ours < 0.98 * min(on_rings)


def test_no_exchange_of_one_pose_improves_the_choice_by_more_than_the_grid_is_coarse(
    rig: RigConfig, chosen: tuple[dict[str, float], ...]
) -> None:
    rng = np.random.default_rng(4)
    ours = expected_error(rig, list(chosen))
    for i in range(len(chosen)):
        tilt, turn = 5.0 * rng.integers(0, 13), 5.0 * rng.integers(-35, 37)
        if {"tilt": tilt, "turn": turn} not in chosen:
            assert expected_error(rig, [*chosen[:i], *chosen[i + 1 :], {"tilt": tilt, "turn": turn}]) >= 0.997 * ours


def test_every_pose_lies_within_the_limits_of_stage_and_tilt_and_none_comes_twice(rig: RigConfig) -> None:
    narrow = (TILT, AxisDescription("turn", "rotation", Limits(-90.0, 120.0, "deg"), 0.01, (0.0, 0.0, 1.0)))
    poses = choose_poses(rig, narrow, ChosenConfig(count=6, largest_tilt_deg=42.0))
    assert len({tuple(pose.items()) for pose in poses}) == len(poses) == 6
    for axis in narrow:
        assert all(pose[axis.name] in axis.soft_limits for pose in poses)
    assert np.rad2deg(np.arccos(directions(rig, list(poses))[:, 2])).max() <= 42.0


def test_the_same_input_gives_the_same_poses(rig: RigConfig, chosen: tuple[dict[str, float], ...]) -> None:
    assert choose_poses(rig, AXES, CHOICE) == chosen


def test_poses_that_were_taken_move_the_choice_elsewhere_and_help_most_together(
    rig: RigConfig, chosen: tuple[dict[str, float], ...]
) -> None:
    more = choose_poses(rig, AXES, ChosenConfig(count=3), already=chosen)
    assert not any(pose in chosen for pose in more)
    alone = choose_poses(rig, AXES, ChosenConfig(count=3))
    both, repeated = (expected_error(rig, [*chosen, *three]) for three in (more, alone))
    assert both < repeated


def test_too_many_poses_for_the_limits_are_refused_with_what_to_do(rig: RigConfig) -> None:
    stuck = AxisDescription("turn", "rotation", Limits(0.0, 0.0, "deg"), 0.01, (0.0, 0.0, 1.0))
    with pytest.raises(InvalidInputError, match=r"chosen.count: is 12, but .* there are 7 poses .* Ask for fewer"):
        choose_poses(rig, (TILT, stuck), ChosenConfig(count=12, largest_tilt_deg=15.0))


def test_chosen_poses_can_be_planned_as_single_poses(rig: RigConfig, chosen: tuple[dict[str, float], ...]) -> None:
    protocol = load_protocol(EXAMPLES / "chosen_poses.toml").model_copy(update={"poses": ()})
    assert protocol.chosen is not None
    listed = protocol.model_validate({**protocol.model_dump(), "poses": tuple({"axes": pose} for pose in chosen)})
    assert Plan.from_protocol(listed).n_poses == len(chosen)


def test_a_stage_that_cannot_turn_is_refused(rig: RigConfig) -> None:
    stuck = [AxisDescription(axis.name, axis.kind, Limits(1.0, 2.0, "deg"), 0.01, axis.vector) for axis in AXES]
    with pytest.raises(InvalidInputError, match="there are 0 poses to choose from"):
        choose_poses(rig, stuck, CHOICE)


def test_axes_that_travel_stay_at_rest(rig: RigConfig) -> None:
    slide = AxisDescription("x", "translation", Limits(2.0, 5.0, "mm"), 0.01, (1.0, 0.0, 0.0))
    poses = choose_poses(rig, (slide, *AXES), ChosenConfig(count=2, largest_tilt_deg=20.0))
    assert [pose["x"] for pose in poses] == [2.0, 2.0]
