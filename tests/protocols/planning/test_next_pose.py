"""Where one more pose would help most."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.limits import Limits
from drivers.stage import AxisDescription
from protocols.planning.next_pose import next_pose
from protocols.planning.planned_poses import PlannedPoses
from protocols.poses.nominal_geometry import lens_and_light
from protocols.poses.patterns import Pose, ring
from tests.protocols.fakes import rig_config


def planned(*poses: Pose, largest_tilt: float = 40.0) -> PlannedPoses:
    axes = (
        AxisDescription("tilt", "rotation", Limits(-largest_tilt, largest_tilt, "deg"), 0.1, (1.0, 0.0, 0.0)),
        AxisDescription("turn", "rotation", Limits(-180.0, 175.0, "deg"), 0.1, (0.0, 0.0, 1.0)),
    )
    return PlannedPoses(rig_config(), axes, poses, 16, 24)


def test_the_pose_lies_where_its_words_say() -> None:
    poses = planned(*ring(0.0, 1), *ring(30.0, 4))
    best = next_pose(poses, range(5))
    assert best is not None
    lens = lens_and_light(poses.rig, poses.axes, [best.position])[0][0]
    tilt, azimuth = np.radians([best.tilt_deg, best.azimuth_deg])
    side = [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)]
    np.testing.assert_allclose(lens / np.linalg.norm(lens), side, atol=1e-9)
    assert f"at tilt {best.tilt_deg:.0f} deg towards azimuth {best.azimuth_deg:.0f} deg" in best.as_text()


def test_it_lowers_the_expected_error_and_the_next_one_less() -> None:
    poses = planned(*ring(0.0, 1), *ring(30.0, 6))
    first, last = next_pose(poses, range(2)), next_pose(poses, range(7))
    assert first is not None
    assert last is not None
    for best in (first, last):
        assert best.error_deg < best.error_without_deg
    assert last.error_without_deg < first.error_without_deg
    assert last.error_without_deg - last.error_deg < first.error_without_deg - first.error_deg


def test_it_stands_on_the_side_that_nobody_looked_from() -> None:
    poses = planned({"tilt": 0.0, "turn": 0.0}, *({"tilt": 35.0, "turn": turn} for turn in (0.0, 20.0, 40.0, 60.0)))
    best = next_pose(poses, range(5))
    assert best is not None
    seen = poses.views.lens.sum(axis=0)[:2]
    there = np.array([np.cos(np.radians(best.azimuth_deg)), np.sin(np.radians(best.azimuth_deg))])
    assert seen @ there < 0.0


def test_it_says_which_pose_of_the_plan_comes_near() -> None:
    poses = planned(*ring(0.0, 1), *ring(30.0, 4))
    best = next_pose(poses, range(5))
    assert best is not None
    assert best.i_pose is None
    going_there = replace(poses, positions=(*poses.positions, best.position))
    again = next_pose(going_there, range(5))
    assert again is not None
    assert again.i_pose == 5
    assert "pose 6 of the plan comes near it" in again.as_text()


def test_it_can_be_asked_before_any_pose() -> None:
    best = next_pose(planned(*ring(20.0, 3)), ())
    assert best is not None
    assert best.error_deg < best.error_without_deg


def test_a_stage_that_can_go_nowhere_else_has_none() -> None:
    assert next_pose(planned({"tilt": 0.0, "turn": 0.0}, largest_tilt=1.0), [0]) is None


@pytest.mark.parametrize("taken", [(), (0, 1)])
def test_the_values_are_plain(taken: tuple[int, ...]) -> None:
    best = next_pose(planned(*ring(20.0, 3)), taken)
    assert best is not None
    values = best.as_dict()
    assert {type(value) for value in values["position"].values()} == {float}
    assert all(isinstance(values[name], float) for name in ("tilt_deg", "azimuth_deg", "error_deg"))
