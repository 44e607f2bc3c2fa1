"""The one world that the simulated camera, light and stage share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.clock import Clock, RealClock
from drivers.simulated.clock import VirtualClock
from drivers.simulated.geometry import (
    Matrix,
    camera_from_lab,
    into,
    stage_rotation,
)
from drivers.simulated.lamp import Lamp
from drivers.simulated.misalignment import true_angles, true_camera_matrix, true_mount
from drivers.simulated.rendering import truth
from drivers.simulated.rendering.render import render
from drivers.simulated.rendering.scene import Scene, build_scene
from drivers.simulated.rendering.truth import Truth
from drivers.simulated.rendering.view import View
from drivers.simulated.seeding import position_key, rng_for
from drivers.simulated.sensor import Sensor
from drivers.simulated.settings import BenchSettings

Array = NDArray[np.float64]
Position = Mapping[str, float]

AXES = ("tilt", "turn")


class World:
    """Scene, clock and state; the devices act on it and never on each other.

    Parameters
    ----------
    bench : BenchSettings
        What stands where.
    scene : Scene
        The sample.
    clock : Clock
        Shared by all devices.
    sensor : Sensor
        The camera's.

    Attributes
    ----------
    position : dict of str to float
        Read-back of the stage axes in degrees.
    n_arrivals : int
        Motions begun so far; the camera counts its repetitions from each one anew.
    strikes : list of tuple
        When (seconds on the clock) and what went wrong on purpose so far.
    camera_matrix : ndarray, shape (3, 3)
        True, in pixels.
    distortion : ndarray, shape (4,)
        True k1, k2, p1, p2 in OpenCV's order.
    """

    def __init__(self, bench: BenchSettings, scene: Scene, clock: Clock, sensor: Sensor | None = None) -> None:
        settings = bench.simulation
        self.bench = bench
        self.scene = scene
        self.clock = clock
        self.sensor = sensor or Sensor()
        self.lamp = Lamp(clock, settings.warm_up_drift, settings.warm_up_s)
        self.position = dict.fromkeys(AXES, 0.0)
        self.n_arrivals = 0
        self.strikes: list[tuple[float, str]] = []
        self.camera_matrix = true_camera_matrix(bench)
        self.distortion = np.array([*settings.distortion, 0.0, 0.0])
        self._mount = true_mount(bench)

    @classmethod
    def from_rig(cls, rig: Mapping[str, Any], clock: Clock | None = None) -> World:
        """Build the world of a parsed rig.toml; without a clock, time is virtual unless the rig says ``real_time``.

        Raises
        ------
        ValueError
            If the scene, or another key of ``[simulation]``, does not exist.
        """
        bench = BenchSettings.from_rig(rig)
        own = RealClock() if bench.simulation.real_time else VirtualClock()
        return cls(bench, build_scene(bench), clock or own)

    def true_angles(self, position: Position | None = None) -> dict[str, float]:
        """Return where the axes truly are, in degrees, when they read `position` (default: now)."""
        settings = self.bench.simulation
        return true_angles(settings, {**self.position, **(position or {})})

    def sample_to_camera(self, position: Position | None = None) -> Matrix:
        """Return the true 4 x 4 matrix (mm) when the stage reads `position` (default: now)."""
        angles = self.true_angles(position)
        sample_to_lab = self._mount @ stage_rotation(angles["tilt"], angles["turn"])
        return camera_from_lab(self.bench.working_distance_mm) @ sample_to_lab

    def camera_in_sample(self, position: Position | None = None) -> Array:
        """Return the lens in the sample frame, mm, shape (3,)."""
        return into(self.sample_to_camera(position), np.zeros(3))

    def light_in_sample(self, position: Position | None = None) -> Array:
        """Return the light in the sample frame, mm, shape (3,)."""
        return into(self.sample_to_camera(position), np.array(self.bench.simulation.light_offset_mm))

    def light_power(self, position: Position | None = None) -> float:
        """Return the true relative power of the warm light at full level when the stage reads `position`."""
        jitter = self._rng("light power", {**self.position, **(position or {})}).standard_normal()
        return float(1.0 + self.bench.simulation.power_jitter * jitter)

    def picture(self, position: Position | None = None, n_threads: int | None = None) -> NDArray[np.float32]:
        """Return what the lens throws on the sensor for light of power 1, shape (height, width, 3)."""
        view = self._view(position)
        return render(self.scene.surface, view, self.bench.height, self.bench.width, n_threads)

    def compile(self) -> None:
        """Have the kernels of `picture` compiled: on a new machine that takes longer than a camera may for a frame."""
        render(self.scene.surface, self._view(None), 2, 2, 1)

    def truth(self, x_mm: ArrayLike, y_mm: ArrayLike) -> Truth:
        """Return normals, depth and materials at points of the sample frame (mm, any shape)."""
        return truth.truth_at(self.scene, x_mm, y_mm)

    def radiance_on_area(
        self, x_mm: ArrayLike, y_mm: ArrayLike, camera_position: ArrayLike, light_position: ArrayLike
    ) -> Array:
        """Return the noise-free radiance of surface points for light of power 1, shape (..., 3).

        That is f(omega_i, omega_o) max(0, n.omega_i) / |light - x|^2 in 1/(sr mm^2), without lobe,
        vignetting or cast shadows (see `sees`); 0 where the surface turns away from either.

        Parameters
        ----------
        x_mm, y_mm : array_like
            Points; they broadcast.
        camera_position, light_position : array_like, shape (3,)
            Sample frame, mm.
        """
        return truth.radiance_at(self.scene, x_mm, y_mm, camera_position, light_position)

    def sees(self, x_mm: ArrayLike, y_mm: ArrayLike, point: ArrayLike) -> NDArray[np.bool_]:
        """Return whether surface points face `point` (sample frame, mm) with nothing in between."""
        return truth.sight_at(self.scene, x_mm, y_mm, point)

    def _rng(self, purpose: str, position: Position) -> np.random.Generator:
        return rng_for(self.bench.simulation.seed, purpose, *position_key(position))

    def _view(self, position: Position | None) -> View:
        settings, K = self.bench.simulation, self.camera_matrix
        k1, k2 = settings.distortion
        # Rows of the rotation into the camera are its axes in the sample frame.
        axes = self.sample_to_camera(position)[:3, :3]
        return View(
            camera=_vector(self.camera_in_sample(position)),
            light=_vector(self.light_in_sample(position)),
            right=_vector(axes[0]),
            down=_vector(axes[1]),
            forward=_vector(axes[2]),
            intrinsics=(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), k1, k2),
            vignetting=settings.vignetting,
            corner_radius=0.5 * float(np.hypot(self.bench.width, self.bench.height)),
            lobe_exponent=settings.lobe_exponent,
        )


def _vector(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
