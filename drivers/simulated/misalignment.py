"""How the bench differs from its rig file: small seeded errors that the analysis has to find out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.geometry import Matrix, rotation, translation
from drivers.simulated.seeding import position_key, rng_for
from drivers.simulated.settings import BenchSettings, SimulationSettings


def true_camera_matrix(bench: BenchSettings) -> NDArray[np.float64]:
    """Return the true intrinsics, shape (3, 3), pixels; the rig file names a nominal focal length."""
    settings = bench.simulation
    focal_error, *shift = rng_for(settings.seed, "camera matrix").standard_normal(3)
    f = bench.focal_length_px * (1.0 + settings.focal_length_error * focal_error)
    centre = np.array([bench.width - 1.0, bench.height - 1.0]) / 2.0
    cx, cy = centre + settings.principal_point_px * np.array(shift)
    return np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])


def true_mount(bench: BenchSettings) -> Matrix:
    """Return the 4 x 4 matrix (mm) from the stage's base to the lab, close to the identity."""
    settings = bench.simulation
    scatter = rng_for(settings.seed, "mount").standard_normal((2, 3))
    turned = rotation(np.radians(settings.mount_rotation_deg) * scatter[0])
    return translation(settings.mount_translation_mm * scatter[1]) @ turned


def true_angles(settings: SimulationSettings, read_back: Mapping[str, float]) -> dict[str, float]:
    """Return where the axes truly are, degrees, when they read `read_back`.

    Backlash and encoder errors are a function of the read-back alone: whoever comes back to a pose,
    in this session or a resumed one, finds the sample in the same place.
    """
    return {axis: value + _axis_error(settings, axis, value) for axis, value in read_back.items()}


def _axis_error(settings: SimulationSettings, axis: str, value: float) -> float:
    rng = rng_for(settings.seed, f"axis {axis}", *position_key({axis: value}))
    return settings.axis_error_deg * float(rng.standard_normal())
