"""Which half angles poses reach, against directions that are known."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.registration.coverage import JUDGED_TO_DEG, SLOPE_DEG, coverage
from tests.synthetic import camera_ring

FULL = camera_ring(200)
AREA = (60.0, 60.0)


def test_a_full_set_of_poses_needs_no_more() -> None:
    assert coverage(FULL, FULL, AREA).advice() == ()


def test_every_view_is_counted_once_wherever_it_sees_the_point() -> None:
    reached = coverage(FULL, FULL, AREA)
    for views in (reached.all_over, *reached.halves.values(), *reached.slopes.values()):
        assert views.sum() == pytest.approx(len(FULL))


def test_one_view_from_above_shows_each_slope_at_its_own_angle() -> None:
    above = np.array([[0.0, 0.0, 1e6]])
    reached = coverage(above, above, AREA)
    assert reached.smallest_deg == pytest.approx(SLOPE_DEG, abs=0.01)
    assert reached.largest_deg == pytest.approx(0.0, abs=0.01)
    # A flat normal, 8 halfway and 8 of the steepest, which stand on the edge of a bin.
    assert 17 * reached.all_over[0] == pytest.approx(1)
    assert 17 * reached.all_over[1] == pytest.approx(8)
    assert 17 * reached.all_over[2:4].sum() == pytest.approx(8)


def test_a_light_beside_the_lens_moves_the_half_angle_by_half_its_angle() -> None:
    above = np.array([[0.0, 0.0, 1e6]])
    light = 1e6 * np.array([[np.sin(np.deg2rad(20.0)), 0.0, np.cos(np.deg2rad(20.0))]])
    assert coverage(above, light, AREA).smallest_deg == pytest.approx(SLOPE_DEG + 10.0, abs=0.01)


def test_poses_on_the_right_leave_slopes_that_face_left_without_their_highlight() -> None:
    right = FULL[FULL[:, 0] > 40.0]
    advice = coverage(right, right, AREA).advice()
    to_left = [text for text in advice if "slopes that face left" in text]
    assert to_left
    assert all("camera and light from the left" in text for text in to_left)
    assert not any("face right" in text for text in advice)


def test_a_gap_of_half_angles_is_told_with_its_degrees() -> None:
    tilt = np.rad2deg(np.arccos(FULL[:, 2] / np.linalg.norm(FULL, axis=1)))
    steep = FULL[tilt > 40.0]
    (text,) = [t for t in coverage(steep, steep, (5.0, 5.0)).advice() if "slopes" not in t]
    first, last = (float(x) for x in text.split("near ")[1].split(" deg")[0].split("-"))
    assert first == 0.0
    assert 20.0 <= last <= 35.0


def test_the_poses_that_the_advice_asks_for_close_the_gap() -> None:
    few = camera_ring(20)
    (text,) = coverage(few, few, AREA).advice()
    n, span = int(text.split()[1]), text.split("near ")[1].split(" deg")[0]
    widest = float(span.split("-")[1])
    more = np.concatenate([few, camera_ring(2 * n, widest_deg=widest)])
    assert coverage(more, more, AREA).advice() == ()


def test_the_half_of_a_large_area_that_views_see_from_afar_is_told() -> None:
    tilt = np.rad2deg(np.arccos(FULL[:, 2] / np.linalg.norm(FULL, axis=1)))
    # Straight above the right half of a wide area, and far to the sides.
    near = FULL[tilt > 50.0]
    over_right = np.array([[x, y, 350.0] for x in (60.0, 90.0, 120.0, 150.0) for y in (-60.0, -20.0, 20.0, 60.0)])
    cameras = np.concatenate([near, over_right])
    advice = coverage(cameras, cameras, (300.0, 100.0)).advice()
    assert any(text.endswith("on the left half") for text in advice)
    assert not any(text.endswith("on the right half") for text in advice)


def test_what_is_judged_ends_before_the_tail_of_the_curves() -> None:
    near = camera_ring(200, widest_deg=JUDGED_TO_DEG + SLOPE_DEG)
    assert coverage(near, near, AREA).advice() == ()
