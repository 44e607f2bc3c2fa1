"""Pixels of one material, each with a normal of its own, as a collocated rig sees them from afar."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.problem import Noise
from analysis.registration.stack import Stack, Truth
from benchmarks.common.scenes import FAR_MM, cap, with_noise
from benchmarks.reproduction.brdf_materials import Angles, Material

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MaterialPixels:
    """What is seen of P pixels in N views.

    Attributes
    ----------
    stack : Stack
        Of independent pixels.
    normals : ndarray, shape (P, 3)
    """

    stack: Stack
    normals: Array

    @classmethod
    def of(
        cls, material: Material, normals: Array, n_views: int, noise: float, rng: np.random.Generator
    ) -> MaterialPixels:
        """Look at a material from `n_views` directions of a cap, with relative noise."""
        camera = cap(n_views, rng)
        n_dot_l = camera @ normals.T
        theta_h = np.arccos(np.clip(n_dot_l, 0.0, 1.0))
        brdf = material.brdf.at(Angles.of(theta_h)).reshape(*theta_h.shape, 3)
        radiance = brdf * np.maximum(n_dot_l, 0.0)[..., None] / FAR_MM**2
        noisy, variance = with_noise(radiance[:, None], noise, rng)
        stack = Stack(
            radiance=noisy,
            variance=variance,
            camera_position=FAR_MM * camera,
            light_position=FAR_MM * camera,
            light_power=np.ones(n_views),
            pixel_pitch=1e-6 * FAR_MM / len(normals),
            pixels="independent",
            truth=Truth(normals[None], np.full((1, len(normals)), np.nan)),
        )
        return cls(stack, normals)

    def curve(self, pixel: int, lowest: float) -> tuple[Array, Array]:
        """Return theta_h (rad), shape (n,), and the BRDF there, (n, 3), of the views whose n.l is above `lowest`."""
        directions = self.stack.camera_position / FAR_MM
        n_dot_l = directions @ self.normals[pixel]
        seen = n_dot_l > lowest
        radiance = self.stack.radiance[seen, 0, pixel].astype(np.float64) * FAR_MM**2
        return np.arccos(np.minimum(n_dot_l[seen], 1.0)), radiance / n_dot_l[seen, None]

    def noise(self, relative: float) -> Noise:
        """Return the noise to expect beyond the stack's own variance: `relative`, and next to nothing in the dark."""
        return Noise(relative, 1e-3 * float(np.median(self.stack.radiance)))
