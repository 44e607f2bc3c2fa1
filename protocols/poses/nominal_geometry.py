"""Where lens and light stand about the sample at a pose, as the rig file says and not as a calibration found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drivers.stage import AxisDescription
from instrument.config.rig import RigConfig
from instrument.session.nominal_views import NominalViews

Array = NDArray[np.float64]

LAB_FROM_CAMERA = np.diag([1.0, -1.0, -1.0])
"""Camera y is minus lab y, and the camera looks down lab z."""


def lens_and_light(
    rig: RigConfig, axes: Sequence[AxisDescription], poses: Sequence[Mapping[str, float]]
) -> tuple[Array, Array]:
    """Return where lens and light stand in the sample frame, mm, each of shape (P, 3).

    Parameters
    ----------
    rig : RigConfig
    axes : sequence of AxisDescription
        From the base to the sample; one that a pose does not name stands at 0.
    poses : sequence of mapping
        P positions by axis, degrees or mm.
    """
    lens = np.array([0.0, 0.0, rig.geometry.working_distance_mm])
    light = lens + LAB_FROM_CAMERA @ np.array(rig.light.offset_mm)
    frames = [lab_from_sample(axes, pose) for pose in poses]
    places = [[R.T @ (point - t) for R, t in frames] for point in (lens, light)]
    return np.reshape(places[0], (-1, 3)), np.reshape(places[1], (-1, 3))


def nominal_views(
    rig: RigConfig, axes: Sequence[AxisDescription], poses: Sequence[Mapping[str, float]], height: int, width: int
) -> NominalViews:
    """Return how the camera sees the sample at P poses.

    Parameters
    ----------
    rig, axes, poses
        As for `lens_and_light`.
    height, width : int
        Pixels of a raw frame.
    """
    lens, light = lens_and_light(rig, axes, poses)
    rotations = [LAB_FROM_CAMERA.T @ lab_from_sample(axes, pose)[0] for pose in poses]
    return NominalViews(
        lens=lens,
        light=light,
        rotation=np.reshape(rotations, (-1, 3, 3)),
        focal_length_px=rig.camera.focal_length_px,
        height=height,
        width=width,
        area_mm=rig.geometry.area_mm,
    )


def lab_from_sample(axes: Sequence[AxisDescription], pose: Mapping[str, float]) -> tuple[Array, Array]:
    """Return rotation, shape (3, 3), and translation, shape (3,), mm, from the sample to the lab."""
    R, t = np.eye(3), np.zeros(3)
    for axis in axes:
        vector = pose.get(axis.name, 0.0) * np.array(axis.vector)
        if axis.kind == "rotation":
            R = R @ Rotation.from_rotvec(np.radians(vector)).as_matrix()
        else:
            t = t + R @ vector
    return R, t
