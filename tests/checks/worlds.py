"""The simulated relief made of greys and seen without noise: what the chain does to it is the chain's own doing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.camera.view import View
from analysis.registration.grid import Grid
from analysis.registration.rectification import rectify
from analysis.registration.stack import Stack
from drivers.simulated.clock import VirtualClock
from drivers.simulated.rendering.materials import Microfacet, table
from drivers.simulated.rendering.scene import build_scene
from drivers.simulated.rendering.truth import Truth
from drivers.simulated.sensor import mosaic
from drivers.simulated.settings import BenchSettings, SimulationSettings
from drivers.simulated.world import World

Array = NDArray[np.float64]

GRID = Grid(64, 64, 0.25)
RINGS = ((0.0, 1), (15.0, 5), (32.0, 6), (45.0, 6))
POSITIONS = [{"tilt": tilt, "turn": 7.0 + 360.0 * k / n} for tilt, n in RINGS for k in range(n)]
GREYS = ((0.45, 0.05, 0.30), (0.20, 0.045, 0.25), (0.30, 0.04, 0.60), (0.10, 0.40, 0.35), (0.60, 0.04, 0.50))
SCALE = np.float32(1e5)  # of radiances per mm^2, so that they are numbers about 1


@dataclass(frozen=True)
class NeutralWorld:
    """A world of greys, with its pictures.

    Attributes
    ----------
    world : World
    mosaics : list of ndarray of float32, shape (height, width)
        As an RGGB sensor without noise has them, one a position.
    """

    world: World
    mosaics: list[NDArray[np.float32]]

    @classmethod
    def build(cls) -> NeutralWorld:
        """Render the pictures."""
        even = SimulationSettings(seed=3, light_offset_mm=(12.0, 0.0, 0.0), vignetting=0.0, lobe_exponent=0.0)
        bench = BenchSettings(320, 240, 1850.0, 350.0, (60.0, 60.0), (), even)
        coloured = build_scene(bench)
        grey = table(tuple(Microfacet("grey", (a, a, a), (f0, f0, f0), alpha) for a, f0, alpha in GREYS))
        world = World(bench, replace(coloured, surface=coloured.surface._replace(rows=grey)), VirtualClock())
        return cls(world, [SCALE * mosaic(world.picture(position)) for position in POSITIONS])

    @property
    def truth(self) -> Truth:
        """The sample at the pixels of `GRID`."""
        points = GRID.points()
        return self.world.truth(points[..., 0], points[..., 1])

    def view(self, position: dict[str, float]) -> View:
        """Return the true camera."""
        matrix, distortion = self.world.sample_to_camera(position), np.array([*self.world.distortion, 0.0])
        return View(self.world.camera_matrix, distortion, matrix[:3, :3], matrix[:3, 3])

    def stack(self, depth: Array | None) -> Stack:
        """Return the pictures on `GRID`, registered to the plane or to a surface, with the true geometry."""
        nothing = np.zeros(self.mosaics[0].shape, np.bool_)
        seen = [
            rectify(raw, (0.003 * raw) ** 2, nothing, "RGGB", self.view(position), GRID.points(depth), GRID.pitch)
            for raw, position in zip(self.mosaics, POSITIONS, strict=True)
        ]
        return Stack(
            radiance=np.stack([r.radiance for r in seen]),
            variance=np.stack([r.variance for r in seen]),
            camera_position=np.stack([self.world.camera_in_sample(p) for p in POSITIONS]),
            light_position=np.stack([self.world.light_in_sample(p) for p in POSITIONS]),
            light_power=np.ones(len(POSITIONS)),
            pixel_pitch=GRID.pitch,
        )

    def radiance(self) -> Array:
        """Return the true radiance of the surface points of `GRID`, shape (N, H, W, 3), NaN where not seen or lit."""
        x, y, _ = np.moveaxis(GRID.points(), -1, 0)
        views = []
        for position in POSITIONS:
            camera, light = self.world.camera_in_sample(position), self.world.light_in_sample(position)
            both = self.world.sees(x, y, camera) & self.world.sees(x, y, light)
            views.append(np.where(both[..., None], self.world.radiance_on_area(x, y, camera, light), np.nan))
        return float(SCALE) * np.stack(views)
