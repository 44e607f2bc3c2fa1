"""The unknowns that a calibration found, each with its standard deviation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.camera_calibration import CameraCalibration
from analysis.lens import LENS_NAMES
from analysis.session_calibration import Calibration
from analysis.session_light import Lighting

_FALLOFF = ("light gradient x", "light gradient y", "vignetting r^2", "vignetting r^4", "lobe exponent")


@dataclass(frozen=True, slots=True)
class Parameter:
    """One unknown.

    Attributes
    ----------
    name, unit : str
    value, sigma : float
        And its standard deviation; NaN for one that was held, or of which none is known.
    """

    name: str
    unit: str
    value: float
    sigma: float

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON has it."""
        return {"name": self.name, "unit": self.unit, "value": self.value, "sigma": self.sigma}

    @property
    def text(self) -> str:
        """The value with as many digits as its sigma supports."""
        if not (np.isfinite(self.sigma) and self.sigma > 0.0):
            return f"{self.value:.6g} {self.unit}".rstrip()
        digits = max(1 - int(np.floor(np.log10(self.sigma))), 0)
        return f"{self.value:.{digits}f} ± {self.sigma:.{digits}f} {self.unit}".rstrip()


def parameters_of(calibration: Calibration) -> tuple[Parameter, ...]:
    """Return the parameters of the lens, of the boards' print and of the light, those that there are."""
    found: list[Parameter] = []
    if calibration.camera is not None:
        found += _of_camera(calibration.camera)
    if calibration.lighting is not None:
        found += _of_light(calibration.lighting)
    return tuple(found)


def _of_camera(camera: CameraCalibration) -> Iterator[Parameter]:
    for name, value in zip(LENS_NAMES, camera.bundle.state.lens.values, strict=True):
        unit = "px" if name in {"f", "cx", "cy"} else ""
        yield Parameter(name, unit, float(value), camera.intrinsics_sigma.get(name, float("nan")))
    yield Parameter("scatter of the print", "mm", camera.bundle.noise.print_sigma, float("nan"))
    yield Parameter("what the lens model leaves, per axis", "px", camera.bundle.noise.floor, float("nan"))


def _of_light(lighting: Lighting) -> Iterator[Parameter]:
    for axis, value, sigma in zip("xyz", lighting.light_offset.value, lighting.light_offset.sigma, strict=True):
        yield Parameter(f"light offset {axis}", "mm", float(value), float(sigma))
    photometry = lighting.photometry
    values = (*photometry.gradient, *photometry.vignetting, photometry.lobe_exponent)
    sigmas = np.sqrt(np.diag(photometry.falloff_covariance))
    for name, value, sigma in zip(_FALLOFF, values, sigmas, strict=True):
        yield Parameter(name, "", float(value), float(sigma))
