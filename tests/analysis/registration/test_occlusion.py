import numpy as np
import pytest

from analysis.registration.grid import Grid
from analysis.registration.occlusion import hidden

GRID = Grid(41, 61, 0.5)
X, Y, _ = np.moveaxis(GRID.points(), -1, 0)


def test_nothing_of_a_plane_is_hidden():
    assert not hidden(np.zeros((41, 61)), GRID, np.array([100.0, 30.0, 20.0])).any()


def test_nothing_of_a_tilted_plane_that_faces_the_camera_is_hidden():
    assert not hidden(0.3 * X - 0.2 * Y, GRID, np.array([100.0, 30.0, 200.0])).any()


@pytest.mark.parametrize("azimuth_deg", [0.0, 37.0, 90.0, 180.0, 215.0])
def test_a_step_hides_what_lies_in_its_shadow(azimuth_deg: float):
    """The plateau lies beyond a line; its edge, seen from far away under 30 degrees, hides height / tan(30 deg)."""
    towards = np.array([np.cos(np.deg2rad(azimuth_deg)), np.sin(np.deg2rad(azimuth_deg))])
    along = X * towards[0] + Y * towards[1]
    height, tangent = 3.0, np.tan(np.deg2rad(30.0))
    depth = np.where(along > 2.0, height, 0.0)
    distance = 1e5
    found = hidden(depth, GRID, np.array([*(distance * towards), distance * tangent]))
    shadow = 2.0 - height / tangent
    # The rim is a slope of up to a pixel's diagonal on the grid; and a ray that leaves the grid first sees no plateau.
    to_rim = np.stack([X + (2.0 - along) * towards[0], Y + (2.0 - along) * towards[1]])
    meets = (np.abs(to_rim[0]) < 14.5) & (np.abs(to_rim[1]) < 9.5)
    inside = (along > shadow + 1.0) & (along < 2.0 - 1.0) & meets
    outside = (along < shadow - 1.0) | (along > 2.0 + 1.0)
    assert inside.sum() > 50
    assert found[inside].all()
    assert not found[outside].any()


def test_a_wall_hides_less_from_a_near_camera_the_closer_it_stands():
    depth = np.where(np.abs(X - 2.0) < 0.3, 2.0, 0.0)
    position = np.array([12.0, 0.0, 10.0])
    row = hidden(depth, GRID, position)[20]
    x = X[20]
    # Seen from x = 12, z = 10, the wall's top at x = 2 to 2.3, z = 2 throws its shadow to x = 2 - 2 * 10 / 8.
    end = 2.0 - 2.0 * 10.0 / 8.0
    assert row[(x > end + 0.5) & (x < 1.4)].all()
    assert not row[(x < end - 0.6) | (x > 2.6)].any()


def test_missing_depth_hides_nothing_and_is_not_hidden():
    depth = np.where(np.abs(X - 2.0) < 0.3, np.nan, 0.0)
    assert not hidden(depth, GRID, np.array([12.0, 0.0, 1.0])).any()


def test_a_position_below_the_top_of_the_surface_is_refused():
    with pytest.raises(ValueError, match="must stand above the surface, whose top is at 0 mm"):
        hidden(np.zeros((41, 61)), GRID, np.array([0.0, 0.0, -1.0]))


def test_a_depth_that_is_not_on_the_grid_is_refused():
    with pytest.raises(ValueError, match=r"depth is \(3, 3\); on this grid it is \(41, 61\)"):
        hidden(np.zeros((3, 3)), GRID, np.array([0.0, 0.0, 9.0]))
