from dataclasses import replace

import numpy as np
import pytest

from analysis.pixels.identifiability import view_problems
from analysis.reconstruction.reconstruction import reconstruct
from analysis.registration.stack import Stack
from instrument.files.validation import InvalidInputError
from tests.synthetic import camera_ring, make_stack


def seen_from(positions: np.ndarray) -> Stack:
    """Return a small stack whose geometry says that the views stood at `positions`."""
    stack = make_stack(n_views=len(positions), size=4)
    return replace(stack, camera_position=positions, light_position=positions)


def at(tilt_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
    tilt, azimuth = np.deg2rad(tilt_deg), np.deg2rad(azimuth_deg)
    x, y = np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth)
    return 350.0 * np.stack([x, y, np.cos(tilt) * np.ones_like(x)], axis=-1)


ONE_PLANE = at(np.linspace(-60.0, 60.0, 20), np.full(20, 30.0))
ONE_CONE = at(np.full(20, 40.0), np.linspace(0.0, 342.0, 20))

each_degenerate_set = pytest.mark.parametrize(
    ("positions", "reason", "remedy"),
    [
        (camera_ring(1), "1 views; at least 4 are needed", "Capture more poses"),
        (camera_ring(3), "3 views; at least 4 are needed", "Capture more poses"),
        (ONE_PLANE, "all poses lie in one plane", "turn the sample about another axis"),
        (ONE_CONE, "all poses lie on one cone", "Add poses at another tilt"),
    ],
    ids=["one view", "three views", "one plane", "one cone"],
)


@each_degenerate_set
def test_views_that_cannot_determine_normals_are_refused_with_reason_and_remedy(
    positions: np.ndarray, reason: str, remedy: str
):
    with pytest.raises(InvalidInputError) as caught:
        reconstruct(seen_from(positions))
    text = str(caught.value)
    assert "The stack cannot be reconstructed." in text
    assert "/entry/geometry/light_position" in text
    assert reason in text
    assert remedy in text


@pytest.mark.parametrize("n_views", [4, 8, 40])
def test_a_spiral_of_poses_is_accepted(n_views: int):
    assert list(view_problems(seen_from(camera_ring(n_views)))) == []


def test_two_cones_are_accepted():
    azimuth = np.linspace(0.0, 300.0, 6)
    positions = np.concatenate([at(np.full(6, 20.0), azimuth), at(np.full(6, 50.0), azimuth)])
    assert list(view_problems(seen_from(positions))) == []


def test_a_plane_with_the_jitter_of_a_stage_is_still_a_plane():
    jittered = ONE_PLANE + 0.3 * np.random.default_rng(0).standard_normal(ONE_PLANE.shape)
    assert len(list(view_problems(seen_from(jittered)))) == 1
