"""Registered stack to normals, depth and BRDF: the loop over geometry."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.depth.integration import integrate_normals
from analysis.depth.uncertainty import depth_sigma
from analysis.palette.scene import ScenePalette, relearn, solve_scene, with_curve_error
from analysis.pixels.fits import PixelFits, joined
from analysis.pixels.identifiability import view_problems
from analysis.pixels.problem import Noise, PixelProblem, estimate_noise, tiles
from analysis.reconstruction.choices import FORCED, Choice, Chosen
from analysis.reconstruction.effects import (
    choose_field,
    choose_light,
    choose_palette,
    choose_parallax,
    choose_power,
    depth_has_settled,
    light_is_uncertain,
    refine_light,
)
from analysis.reconstruction.error_budget import ErrorBudget, error_budget
from analysis.reconstruction.gross_shape import NO_SHAPE, gross_shape, shape_choice
from analysis.reconstruction.options import ACCURACIES, Options
from analysis.reflectance import dictionary as dictionaries
from analysis.reflectance.palette_completion import MaterialBrdfs
from analysis.registration.lighting import LightOffset
from analysis.registration.stack import Stack
from analysis.stages import Stages
from instrument.files.validation import raise_if_any

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Reconstruction:
    """What a stack says about its sample.

    Attributes
    ----------
    fits : PixelFits
        Of the H * W pixels in reading order.
    depth, depth_sigma : ndarray, shape (H, W)
        Millimetres, mean 0; NaN for independent pixels and holes.
    stack : Stack
        As it was fitted: with the light that was used, following the surface where that was chosen.
    noise : Noise
    light_offset : LightOffset or None
        Where it was estimated.
    palette : ScenePalette or None
        Where one was used.
    materials : MaterialBrdfs or None
        The palette's materials over all angles.
    choices : tuple of Choice
    budget : ErrorBudget or None
        What each error that the stack states adds to the normals; what all views share is in the fits' sigma.
    """

    fits: PixelFits
    depth: Array
    depth_sigma: Array
    stack: Stack
    noise: Noise
    light_offset: LightOffset | None
    palette: ScenePalette | None
    materials: MaterialBrdfs | None
    choices: tuple[Choice, ...]
    budget: ErrorBudget | None

    @property
    def normals(self) -> Array:
        """Unit normals, shape (H, W, 3)."""
        return self.fits.normals.reshape(*self.depth.shape, 3)


def reconstruct(stack: Stack, options: Options | None = None, stages: Stages | None = None) -> Reconstruction:
    """Reconstruct normals, depth and BRDF of every pixel.

    Parameters
    ----------
    stack : Stack
    options : Options or None
        None = the defaults.
    stages : Stages or None
        Takes the time and memory of each stage.

    Raises
    ------
    InvalidInputError
        If the views cannot determine normals (`view_problems`).
    """
    options = options or Options()
    raise_if_any("The stack cannot be reconstructed.", view_problems(stack))
    run = _Run(stack, options, stages or Stages())
    n_updates = ACCURACIES[options.accuracy] if run.surface else 0
    if run.scene is None or n_updates == 0:
        run.solve(None)
    for update in range(n_updates):
        run.update_geometry(first=update == 0)
        if run.has_settled(update + 1):
            break
    return run.result()


class _Run:
    """A reconstruction under way: what is known so far, and the steps that add to it."""

    def __init__(self, stack: Stack, options: Options, stages: Stages) -> None:
        self.options, self.stages = options, stages
        self.rng = np.random.default_rng(options.seed)
        self.dictionary = dictionaries.by_name(options.dictionary)
        self.surface = stack.pixels == "surface" and not options.independent
        self.fits: PixelFits | None = None
        self.follow = False
        self.depth = np.full(stack.grid.points().shape[:2], np.nan)
        self.new_depth: Array | None = None
        self.shape = NO_SHAPE
        field = choose_field(stack, options.field)
        with stages.measure("noise and light"):
            self.light = choose_light(field.value, self.dictionary, options.light, self.rng)
            stack = self.light.value.stack
            self.noise = estimate_noise(stack, self.dictionary, self.rng)
        with stages.measure("palette"):
            palette = choose_palette(stack, self.dictionary, self.noise, options.palette, self.surface, self.rng)
            power = choose_power(stack, palette.value, self.noise, options.power)
            stack, self.scene = power.value.stack, power.value.palette
            if self.scene is not None:
                self.noise = self.scene.noise(stack, self.noise)
        self.stack = self.fitted = stack
        self.effects = [field.choice, palette.choice, power.choice]
        self.updates = Chosen(False, Choice("depth updates", "0", FORCED))

    def solve(self, depth: Array | None) -> None:
        """Solve all pixels with the geometry as it is."""
        with self.stages.measure("normals and BRDF"):
            start, threads = None if self.fits is None else self.fits.normals, self.options.threads
            track = self.stages.track
            if self.scene is not None:
                fits = solve_scene(self.scene, self.fitted, self.noise, depth, start, threads=threads, track=track)
                self.fits = with_curve_error(fits, self.scene, self.fitted, self.noise, depth)
            else:
                tolerance, pixels = self.options.tolerance, np.arange(self.depth.size)
                parts = [
                    PixelProblem(self.fitted, self.dictionary, tile, depth).solve(
                        self.noise, start=None if start is None else start[tile], tolerance=tolerance, threads=threads
                    )
                    for tile in track(list(tiles(pixels)))
                ]
                self.fits = joined(parts)

    def update_geometry(self, *, first: bool) -> None:
        """Integrate the depth, let views, light and palette follow it, and solve again."""
        with self.stages.measure("depth"):
            self.depth = self._depth()
        self.new_depth = None
        with self.stages.measure("parallax"):
            if first:
                chosen = choose_parallax(
                    self.stack, self.depth, self.dictionary, self.noise, self.options.parallax, self.rng
                )
                self.follow = chosen.value
                self.effects.append(chosen.choice)
            self._tie_to_plane()
            self.fitted = self._following()
        if first and light_is_uncertain(self.stack, self.options.light):
            with self.stages.measure("noise and light"):
                self.light = refine_light(self.stack, self.fitted, self.depth, self.dictionary, self.noise, self.rng)
                self.stack = self.light.value.stack
                self.fitted = self._following()
        if self.scene is not None:
            with self.stages.measure("palette"):
                self.scene = relearn(self.scene, self.fitted, self.noise, self.depth)
                self.noise = self.scene.noise(self.fitted, self.noise, self.depth)
        self.solve(self.depth)

    def _tie_to_plane(self) -> None:
        """Correct the depth's level, tilt and bowl by what the parallax between the views says of them."""
        if not self.follow:
            return
        flat = self.depth - self.shape.depth(self.stack)
        self.shape = gross_shape(self.stack, flat, self.dictionary, self.noise, self.shape, self.rng)
        self.depth = flat + self.shape.depth(self.stack)

    def _following(self) -> Stack:
        return replace(self.stack, followed=self.depth) if self.follow else self.stack

    def has_settled(self, n_updates: int) -> bool:
        """Tell whether another update of the geometry would change nothing."""
        with self.stages.measure("depth"):
            self.new_depth = self._depth()
        self.updates = depth_has_settled(self.stack, self.depth, self.new_depth, self.follow, n_updates)
        return self.updates.value

    def _depth(self) -> Array:
        if self.new_depth is not None:
            return self.new_depth
        if self.fits is None:
            # The palette's grid of pixels is fine enough for a first depth.
            assert self.scene is not None
            return self.scene.depth(self.stack)
        sigma = self.fits.normal_sigma.reshape(self.depth.shape)
        depth = integrate_normals(_as_map(self.fits.normals, self.stack), self.stack.pixel_pitch, sigma=sigma)
        return depth + self.shape.depth(self.stack)

    def result(self) -> Reconstruction:
        """Return what came of it."""
        assert self.fits is not None
        sigma = np.full(self.depth.shape, np.nan)
        if self.surface:
            with self.stages.measure("depth"):
                self.depth = self._depth()
                normal_sigma = self.fits.normal_sigma.reshape(self.depth.shape)
                sigma = depth_sigma(normal_sigma, self.stack.pixel_pitch, self.rng, weighted=True)
        else:
            forced = self.options.independent
            reason = FORCED if forced else "the stack says that its pixels are independent"
            self.effects.append(Choice("depth", "off", reason))
        if self.surface:
            self.effects.append(self.updates.choice)
        if self.follow:
            self.effects.append(shape_choice(self.shape))
            self.depth = self.depth - np.nanmean(self.depth)
        text = "the typical residual made one of its stated sigma"
        self.effects.append(Choice("relative error", f"{self.noise.relative:.4f}", text))
        materials = self._complete()
        budget = self._budget()
        return Reconstruction(
            fits=self.fits,
            depth=self.depth,
            depth_sigma=sigma,
            stack=self.fitted,
            noise=self.noise,
            light_offset=self.light.value.offset,
            palette=self.scene,
            materials=materials,
            choices=(self.light.choice, *self.effects),
            budget=budget,
        )

    def _budget(self) -> ErrorBudget | None:
        """Find what the stated errors of the calibration do to the normals, and add to their sigma what all share."""
        if not self.fitted.states_errors:
            return None
        assert self.fits is not None
        with self.stages.measure("error budget"):
            depth = self.depth if self.surface else None
            budget = error_budget(self.fitted, self.dictionary, self.noise, self.rng, depth)
            self.fits = self.fits.widened(np.deg2rad(budget.systematic))
        return budget

    def _complete(self) -> MaterialBrdfs | None:
        """Give the palette's materials their values beyond the slice, for views from elsewhere."""
        if self.scene is None:
            return None
        assert self.fits is not None
        with self.stages.measure("palette"):
            materials = self.scene.brdfs(self.fitted, self.noise, self.depth if self.surface else None)
            self.fits = replace(self.fits, dictionary=materials.dictionary(self.fits.dictionary))
        return materials


def _as_map(values: Array, stack: Stack) -> Array:
    return values.reshape(stack.grid.height, stack.grid.width, -1)
