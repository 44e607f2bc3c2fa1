"""How well a flat field predicts pictures that it was not fitted to."""

from __future__ import annotations

import numpy as np

from analysis.light.flat_field import FlatField
from analysis.light.flat_samples import PlanePicture, plane_samples


def prediction_error(field: FlatField, picture: PlanePicture) -> float:
    """Return the relative RMS by which a plane differs from what a flat field predicts, its own power aside."""
    samples = plane_samples([picture])
    to_light = field.light_offset - samples.in_camera
    distance = np.linalg.norm(to_light, axis=1)
    shading = np.log(np.sum(to_light * samples.normal, axis=1) / distance**3)
    residual = samples.log_radiance - shading - np.log(field.gain_at(samples.pixel, samples.in_camera))
    return float(np.std(residual - np.median(residual)))
