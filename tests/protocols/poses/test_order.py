from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np

from protocols.poses.order import in_short_order

Poses = tuple[dict[str, float], ...] | list[dict[str, float]]


def way(poses: Poses) -> float:
    """Degrees from 0 through all poses, the axes moving at once."""
    return sum(max(abs(b[name] - a[name]) for name in b) for a, b in pairwise([dict.fromkeys(poses[0], 0.0), *poses]))


def scattered(n: int, seed: int) -> list[dict[str, float]]:
    rng = np.random.default_rng(seed)
    return [{"tilt": rng.uniform(0.0, 60.0), "turn": rng.uniform(-180.0, 180.0)} for _ in range(n)]


def test_every_pose_comes_once() -> None:
    poses = scattered(30, 0)
    ordered = in_short_order(poses)
    assert sorted(map(str, ordered)) == sorted(map(str, poses))


def test_no_order_of_six_poses_is_much_shorter() -> None:
    for seed in range(5):
        poses = scattered(6, seed)
        assert way(in_short_order(poses)) <= 1.25 * min(map(way, map(list, permutations(poses))))


def test_many_poses_take_a_fraction_of_the_way_of_their_first_order() -> None:
    poses = scattered(60, 1)
    assert way(in_short_order(poses)) < 0.25 * way(poses)


def test_no_part_turned_round_shortens_the_way() -> None:
    ordered = list(in_short_order(scattered(25, 2)))
    for i in range(25):
        for j in range(i + 1, 25):
            turned = [*ordered[:i], *ordered[i : j + 1][::-1], *ordered[j + 1 :]]
            assert way(turned) >= way(ordered) - 1e-6


def test_nothing_is_in_order() -> None:
    assert in_short_order([]) == ()
