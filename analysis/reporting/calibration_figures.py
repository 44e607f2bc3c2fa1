"""The pictures of a calibration's report, those that there is something to draw for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.calibration.light import Lighting
from analysis.calibration.session import Calibration
from analysis.camera.calibration import CameraCalibration, normalised
from analysis.registration.coverage import Coverage
from analysis.reporting import corner_figures, light_figures
from analysis.reporting.session_facts import SessionFacts


@dataclass(frozen=True, slots=True)
class Drawing:
    """A picture of the report.

    Attributes
    ----------
    caption : str
    png : bytes
    is_wide : bool
        Whether it needs the width of the page.
    """

    caption: str
    png: bytes
    is_wide: bool = False


def calibration_figures(calibration: Calibration, facts: SessionFacts, reached: Coverage | None) -> Iterator[Drawing]:
    """Yield the pictures, one after the other."""
    if calibration.camera is not None:
        yield from _corners(calibration.camera, calibration, facts)
    if calibration.lighting is not None:
        yield from _light(calibration.lighting, calibration, facts)
    if calibration.radiometry.response is not None:
        yield Drawing("Response curve", light_figures.response_curve(calibration.radiometry.response))
    if calibration.flat is not None:
        at = calibration.flat.only_at_mm or calibration.distance_mm or 1000.0
        yield Drawing(f"Flat field at {at:.0f} mm", light_figures.flat_map(calibration.flat, at))
    if reached is not None:
        caption = "Half angles that the views reach; red: fewest that are wanted"
        yield Drawing(caption, light_figures.half_angles(reached), is_wide=True)


def _corners(camera: CameraCalibration, calibration: Calibration, facts: SessionFacts) -> Iterator[Drawing]:
    i_pose, worst = calibration.i_pose, int(camera.view_rms.argmax())
    drawn = corner_figures.residual_vectors(camera, facts.image_size)
    yield Drawing("Residuals of the corners over the picture, all views", drawn)
    drawn = corner_figures.regional_means(camera, facts.image_size)
    yield Drawing("What the corners have in common, region by region", drawn)
    if facts.worst_preview is not None:
        name = f"pose {i_pose[worst]}"
        drawn = corner_figures.worst_view(camera, facts.worst_preview, facts.image_size, name)
        yield Drawing(f"The worst view, {name}, with its residuals", drawn)
    yield Drawing("Residuals of each view", corner_figures.view_bars(camera, i_pose))
    lengths = [normalised(c, r, camera.bundle.noise) for c, r in zip(camera.corners, camera.residuals, strict=True)]
    yield Drawing("Residuals over their sigmas", corner_figures.normalised_histogram(np.concatenate(lengths)))
    yield Drawing("What the print of each board is off by", corner_figures.print_displacements(camera))
    yield Drawing("Where the camera stood", light_figures.poses(camera.camera_position, i_pose, worst))


def _light(lighting: Lighting, calibration: Calibration, facts: SessionFacts) -> Iterator[Drawing]:
    photometry = lighting.photometry
    drawn = light_figures.powers(photometry, facts.seconds, calibration.i_pose)
    yield Drawing("Power of the light in each view", drawn)
    drawn = light_figures.white_residuals(lighting.white, photometry.residual, facts.image_size)
    yield Drawing("Residuals of the white over the picture, mean of all views", drawn)
