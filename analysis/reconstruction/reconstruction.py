"""Registered stack to normals, depth and BRDF: the loop over geometry."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.depth.integration import integrate_normals
from analysis.depth.uncertainty import depth_sigma
from analysis.few_views.method import FewViews, solve_few_views
from analysis.few_views.solution import fits_of, materials_of
from analysis.palette.materials import leading_material
from analysis.palette.scene import ScenePalette, relearn, solve_scene, with_curve_error
from analysis.pixels.fits import PixelFits, joined
from analysis.pixels.identifiability import view_problems
from analysis.pixels.problem import (
    Noise,
    NormalPrior,
    PixelProblem,
    estimate_noise,
    model_error_share,
    tiles,
)
from analysis.pixels.trimming import without_highlights
from analysis.reconstruction import views_apart
from analysis.reconstruction.choices import FORCED, Choice, Chosen
from analysis.reconstruction.effects import (
    choose_dictionary,
    choose_field,
    choose_light,
    choose_neighbours,
    choose_palette,
    choose_parallax,
    choose_power,
    depth_has_settled,
    found_powers,
    light_by_plane,
    light_is_uncertain,
    light_is_unknown,
    may_be_few_views,
    power_choice,
    refine_light,
    smoother_text,
    theta_d_sigma,
)
from analysis.reconstruction.error_budget import ErrorBudget, error_budget
from analysis.reconstruction.gross_shape import NO_SHAPE, gross_shape, shape_choice
from analysis.reconstruction.left_out import trial
from analysis.reconstruction.options import ACCURACIES, Options
from analysis.reflectance.dictionary import lambertian
from analysis.reflectance.palette_completion import MaterialBrdfs
from analysis.registration.lighting import LightOffset
from analysis.registration.stack import Stack
from analysis.stages import Stages
from instrument.files.validation import raise_if_any

Array = NDArray[np.float64]

WORSE = 0.95
"""A palette is given up where views left out are predicted so much better without it."""


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
        Where one was used that was found from solved pixels.
    few_views : FewViews or None
        Where materials were told by colour.
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
    few_views: FewViews | None
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
    stages = stages or Stages()
    run = _Run(stack, options, stages, _by_colour(stack, options, stages))
    n_updates = ACCURACIES[options.accuracy] if run.surface else 0
    if run.scene is None or n_updates == 0:
        run.solve(None)
    for update in range(n_updates):
        run.update_geometry(first=update == 0)
        if run.has_settled(update + 1):
            break
    run.ask_neighbours()
    run.try_colours()
    return run.result()


def _by_colour(stack: Stack, options: Options, stages: Stages) -> FewViews | None:
    """Solve a scene of few views with materials by colour, where that may serve it: also for its powers and light."""
    surface = stack.pixels == "surface" and not options.independent
    if not may_be_few_views(stack, options.palette, surface=surface):
        return None
    if options.light == "collocated":
        stack = replace(stack, light_position=stack.camera_position)
    with stages.measure("few views"):
        return solve_few_views(
            stack,
            find_power=options.power != "given" and stack.light_power_sigma is None,
            find_light=light_is_unknown(stack, options.light),
            seed=options.seed,
            threads=options.threads,
            track=stages.track,
        )


class _Run:
    """A reconstruction under way: what is known so far, and the steps that add to it."""

    def __init__(self, stack: Stack, options: Options, stages: Stages, by_colour: FewViews | None) -> None:
        self.options, self.stages, self.by_colour = options, stages, by_colour
        self.rng = np.random.default_rng(options.seed)
        dictionary = choose_dictionary(stack, options.dictionary)
        self.dictionary = dictionary.value
        self.surface = stack.pixels == "surface" and not options.independent
        self.fits: PixelFits | None = None
        self.few: FewViews | None = None
        self.follow = False
        self.depth = np.full(stack.grid.points().shape[:2], np.nan)
        self.new_depth: Array | None = None
        self.shape = NO_SHAPE
        field = choose_field(stack, options.field)
        with stages.measure("noise and light"):
            if by_colour is not None and by_colour.offset is not None:
                self.light = light_by_plane(field.value, by_colour.offset)
            else:
                self.light = choose_light(field.value, self.dictionary, options.light, self.rng)
            stack = self.light.value.stack
            found = None if by_colour is None else found_powers(stack, by_colour)
            stack = stack if found is None else found.value
            self.noise = estimate_noise(stack, self.dictionary, self.rng)
        with stages.measure("palette"):
            palette = choose_palette(stack, self.dictionary, self.noise, options.palette, self.surface, self.rng)
            power = choose_power(stack, palette.value, self.noise, options.power)
            stack, self.scene = power.value.stack, power.value.palette
            if self.scene is not None:
                self.noise = self.scene.noise(stack, self.noise)
        self.stack = self.fitted = stack
        powers = (
            [power.choice] if found is None else [found.choice, replace(power.choice, effect="light power, refined")]
        )
        self.effects = [dictionary.choice, field.choice, palette.choice, *powers]
        self.updates = Chosen(False, Choice("depth updates", "0", FORCED))

    def solve(self, depth: Array | None) -> None:
        """Solve all pixels with the geometry as it is."""
        with self.stages.measure("normals and BRDF"):
            self.fits = self._solved(depth, None if self.fits is None else self.fits.normals)

    def _solved(self, depth: Array | None, start: Array | None, prior: NormalPrior | None = None) -> PixelFits:
        threads, track = self.options.threads, self.stages.track
        if self.scene is not None:
            fits = solve_scene(
                self.scene, self.fitted, self.noise, depth, start, prior=prior, threads=threads, track=track
            )
            return with_curve_error(fits, self.scene, self.fitted, self.noise, depth)
        tolerance, pixels, stack = self.options.tolerance, np.arange(self.depth.size), self._solved_stack()
        parts = [
            PixelProblem(stack, self.dictionary, tile, depth).solve(
                self.noise,
                start=None if start is None else start[tile],
                prior=None if prior is None else prior.select(tile),
                tolerance=tolerance,
                threads=threads,
            )
            for tile in track(list(tiles(pixels)))
        ]
        return joined(parts)

    def ask_neighbours(self) -> None:
        """Solve once more with what neighbours say of each other's normals, where that tells them better."""
        if not self.surface:
            return
        assert self.fits is not None
        alone, depth = self.fits, None if np.isnan(self.depth).all() else self.depth
        with self.stages.measure("neighbours"):
            material = np.zeros(len(alone.normals), np.int64) if self.scene is None else leading_material(alone)
            chosen = choose_neighbours(alone, self.stack.grid, material, self.options.neighbours, self.rng)
            self.effects.append(chosen.choice)
            if chosen.value is None:
                return
            told = chosen.value
            fits = self._solved(depth, told.prior.normal, told.prior)
            # A mean over neighbours leaves the model's error as it is.
            common = model_error_share(self.fitted, self.noise, self.rng)
            covariance = (1.0 - common) * told.inflation * fits.covariance + common * alone.covariance
            self.fits = replace(fits, covariance=covariance)
            self.new_depth = None

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

    def try_colours(self) -> None:
        """Take the solution by colour, where that predicts views left out better; pixels on their own likewise."""
        if self.by_colour is None:
            return
        if self.options.palette == "colour":
            self._take(self.by_colour, FORCED)
            return
        with self.stages.measure("few views"):
            tried = trial(
                self.by_colour,
                stack=self.fitted,
                dictionary=self.dictionary,
                noise=self.noise,
                depth=self.depth,
                scene=self.scene,
                seed=self.options.seed,
                threads=self.options.threads,
            )
        if tried.colour < min(tried.palette, tried.alone):
            self._take(self.by_colour, tried.text)
        elif self.scene is not None and tried.alone < WORSE * tried.palette:
            self._drop_palette(tried.text)

    def _take(self, few: FewViews, reason: str) -> None:
        """Go on with the solution of few views."""
        self.few, self.scene, self.follow = few, None, False
        self.stack = self.fitted = few.stack
        self.fits, self.new_depth = fits_of(few), None
        self.noise = Noise(float(np.median(few.state.sigma[few.state.leading()])), few.state.dark)
        flat = "materials by colour take the sample as flat"
        self.effects = [
            *self.effects[:2],
            Choice("palette", f"{few.state.n_materials} materials by colour", reason),
            power_choice(few),
            Choice("parallax", "off", flat),
            Choice("neighbours", "on", smoother_text(few.smoother)),
        ]
        self.updates = Chosen(True, Choice("depth updates", "0", flat))

    def _drop_palette(self, reason: str) -> None:
        """Solve all pixels on their own after all."""
        self.scene = None
        self.effects = [c for c in self.effects if c.effect not in {"palette", "neighbours"}]
        self.effects.insert(2, Choice("palette", "off", reason))
        self.solve(None if np.isnan(self.depth).all() else self.depth)
        self.ask_neighbours()

    def _tie_to_plane(self) -> None:
        """Correct the depth's level, tilt and bowl by what the parallax between the views says of them."""
        if not self.follow:
            return
        flat = self.depth - self.shape.depth(self.stack)
        self.shape = gross_shape(self.stack, flat, self.dictionary, self.noise, self.shape, self.rng)
        self.depth = flat + self.shape.depth(self.stack)

    def _following(self) -> Stack:
        return replace(self.stack, followed=self.depth) if self.follow else self.stack

    def _solved_stack(self) -> Stack:
        return without_highlights(self.fitted) if self.dictionary is lambertian() else self.fitted

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
        # Before the depth, whose sigma follows from that of the normals.
        self._hear_views_apart()
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
        self.fits = self.fits.widened(theta_d_sigma(self.stack))
        return Reconstruction(
            fits=self.fits,
            depth=self.depth,
            depth_sigma=sigma,
            stack=self.fitted,
            noise=self.noise,
            light_offset=self.light.value.offset,
            palette=self.scene,
            few_views=self.few,
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

    def _hear_views_apart(self) -> None:
        """Widen the normals' sigma where parts of the views say different normals."""
        if self.few is not None or self.stack.n_views < views_apart.MIN_VIEWS:
            return
        assert self.fits is not None
        with self.stages.measure("normals and BRDF"):
            ratio = views_apart.variance_ratio(self._solved_stack(), self.fits, self._some_solved, self.rng)
        self.fits = replace(self.fits, covariance=ratio * self.fits.covariance)
        text = "views left out in blocks, by azimuth and by tilt, move the typical normal as far as that says"
        self.effects.append(Choice("sigma", f"{np.sqrt(ratio):.2f} times", text))

    def _some_solved(self, stack: Stack, pixels: NDArray[np.int64], start: Array) -> PixelFits:
        depth = self.depth if self.surface else None
        if self.scene is not None:
            return solve_scene(self.scene, stack, self.noise, depth, start, pixels=pixels)
        return PixelProblem(stack, self.dictionary, pixels, depth).solve(self.noise, start=start)

    def _complete(self) -> MaterialBrdfs | None:
        """Give the palette's materials their values beyond the slice, for views from elsewhere."""
        if self.scene is None and self.few is None:
            return None
        assert self.fits is not None
        with self.stages.measure("palette"):
            if self.few is not None:
                materials = materials_of(self.few, self.fits)
            else:
                assert self.scene is not None
                materials = self.scene.brdfs(self.fitted, self.noise, self.depth if self.surface else None)
            self.fits = replace(self.fits, dictionary=materials.dictionary(self.fits.dictionary))
        return materials


def _as_map(values: Array, stack: Stack) -> Array:
    return values.reshape(stack.grid.height, stack.grid.width, -1)
