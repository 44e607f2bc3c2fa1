"""Where camera and light stand in each view, in the sample frame: the poses of our protocol on an ideal stage."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis.camera.view import View
from instrument.config.loading import load_protocol
from protocols.planning.plan import stated_poses

Array = NDArray[np.float64]

PROTOCOL = Path(__file__).parents[3] / "examples" / "hdr_sweep.toml"

DISTANCE_MM = 350.0

LIGHT_OFFSET_MM = (12.6, -1.1, 0.4)
"""Of the light from the lens in the camera frame; a capture states what a ruler says."""

LIGHT_BY_RULER_MM, LIGHT_SIGMA_MM = (12.0, 0.0, 0.0), 3.0

_FIELD_MM = 100.0  # height of the picture in the sample plane, seen from straight above


@dataclass(frozen=True)
class Camera:
    """An ideal camera.

    Attributes
    ----------
    width, height : int
        Pixels.
    """

    width: int
    height: int

    @property
    def focal_length_px(self) -> float:
        """Focal length, pixels: the plate fills the picture."""
        return self.height * DISTANCE_MM / _FIELD_MM

    @property
    def pixel_mm(self) -> float:
        """Size of a pixel in the sample plane, seen from straight above."""
        return DISTANCE_MM / self.focal_length_px

    @property
    def matrix(self) -> Array:
        """Camera matrix; integers are centres of pixels."""
        f = self.focal_length_px
        return np.array([[f, 0.0, (self.width - 1) / 2], [0.0, f, (self.height - 1) / 2], [0.0, 0.0, 1.0]])

    @property
    def field_of_view_deg(self) -> float:
        """Across the width, edge to edge."""
        return float(np.rad2deg(2.0 * np.arctan(0.5 * self.width / self.focal_length_px)))


@dataclass(frozen=True)
class Placement:
    """A camera and a light in the sample frame.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
        Sample to camera (x right, y down, z forward).
    camera, light : ndarray, shape (3,)
        Millimetres.
    """

    rotation: Array
    camera: Array
    light: Array

    def view(self, camera: Camera) -> View:
        """Return what projects points of the sample into the picture."""
        return View(camera.matrix, np.zeros(5), self.rotation, -self.rotation @ self.camera)

    @property
    def to_world(self) -> Array:
        """Camera to sample, shape (4, 4), for a camera that looks along z with y up and so x to the left."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation.T * [-1.0, -1.0, 1.0]
        matrix[:3, 3] = self.camera
        return matrix


def captured() -> list[Placement]:
    """Return the 65 views of the protocol, the light beside the lens."""
    poses = stated_poses(load_protocol(PROTOCOL))
    return [_placed(pose["tilt"], pose["turn"], LIGHT_OFFSET_MM) for pose in poses]


def novel() -> list[Placement]:
    """Return two views with a light well off the lens, which no view of the capture had."""
    return [_placed(15.0, 40.0, (190.0, 20.0, 60.0)), _placed(25.0, 250.0, (-150.0, -170.0, 80.0))]


def _placed(tilt_deg: float, turn_deg: float, light_offset: tuple[float, float, float]) -> Placement:
    # The turntable rides on the tilt; the lens looks down the lab's z axis from the working distance.
    lab = Rotation.from_euler("x", tilt_deg, degrees=True) * Rotation.from_euler("z", turn_deg, degrees=True)
    rotation = np.diag([1.0, -1.0, -1.0]) @ lab.as_matrix()
    camera = rotation.T @ np.array([0.0, 0.0, -DISTANCE_MM])
    return Placement(rotation, camera, camera + rotation.T @ np.array(light_offset))
