from dataclasses import replace

import numpy as np
import pytest

from analysis.light.plane import offset_by_plane
from analysis.registration.lighting import light_position, looking_at_centre
from analysis.registration.stack import Stack


@pytest.fixture
def stack() -> Stack:
    camera = np.array([[10.0, 5.0, 300.0], [-60.0, 30.0, 280.0], [40.0, -50.0, 290.0], [0.0, 80.0, 285.0]])
    return Stack(
        radiance=np.ones((4, 12, 12, 3), np.float32),
        camera_position=camera,
        light_position=camera,
        pixel_pitch=1.0,
        light_power=np.ones(4),
        camera_rotation=looking_at_centre(camera),
    )


def leaning(stack: Stack, offset: tuple[float, float]) -> np.ndarray:
    """Normals of a plane as they come out with the light in the lens where it stands beside it."""
    h_true, h_taken = (
        half(replace(stack, light_position=light_position(stack, np.array([*o, 0.0])))) for o in (offset, (0.0, 0.0))
    )
    lean = (h_taken - h_true).mean(axis=0) + np.array([0.0, 0.0, 1.0])
    return np.tile(lean / np.linalg.norm(lean), (12, 12, 1))


def half(stack: Stack) -> np.ndarray:
    light, camera = (
        p / np.linalg.norm(p, axis=1, keepdims=True) for p in (stack.light_position, stack.camera_position)
    )
    return (light + camera) / np.linalg.norm(light + camera, axis=1, keepdims=True)


@pytest.mark.parametrize("offset", [(3.0, 11.0), (-18.0, 9.0), (0.0, 0.0)])
def test_the_offset_is_what_makes_the_mean_normal_lean(stack: Stack, offset: tuple[float, float]):
    found = offset_by_plane(stack, leaning(stack, offset))
    np.testing.assert_allclose(found.value[:2], offset, atol=0.06 * np.hypot(*offset) + 0.1)
    assert np.all(found.sigma[:2] > 2.0)


def test_blocks_that_lean_in_different_ways_make_it_less_certain(stack: Stack):
    normals = leaning(stack, (0.0, 0.0))
    rng = np.random.default_rng(0)
    rough = normals + np.concatenate([0.1 * rng.standard_normal((12, 12, 2)), np.zeros((12, 12, 1))], axis=-1)
    rough /= np.linalg.norm(rough, axis=-1, keepdims=True)
    assert offset_by_plane(stack, rough).sigma[0] > offset_by_plane(stack, normals).sigma[0]


def test_without_rotations_or_normals_there_is_no_offset(stack: Stack):
    with pytest.raises(ValueError, match="camera_rotation"):
        offset_by_plane(replace(stack, camera_rotation=None), leaning(stack, (1.0, 1.0)))
    with pytest.raises(ValueError, match="no pixel is solved"):
        offset_by_plane(stack, np.full((12, 12, 3), np.nan))
