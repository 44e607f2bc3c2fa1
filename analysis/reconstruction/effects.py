"""Which effects a scene needs modelled: each chosen from evidence, with its reason, or forced by an option.

Every `choose_` function takes the option's value (`reconstruction.Options`) and returns what follows from the
choice with the `Choice` to record, as a `Chosen` value.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.few_views.field import Smoother, Told, ask_neighbours
from analysis.few_views.method import FewViews, binning_for, solve_few_views
from analysis.light.offset import FEW_VIEWS, estimate_light_offset, pooled_light_offset
from analysis.light.plane import TORCH_MM
from analysis.palette.scene import MIN_SOLVED, NO_PALETTE_SHARE, ScenePalette, learn, relearn
from analysis.pixels.fits import PixelFits
from analysis.pixels.parallax import follow_pixels, parallax_shift
from analysis.pixels.problem import Noise, PixelProblem, estimate_noise, sample_pixels
from analysis.reconstruction.choices import FORCED, Choice, Chosen
from analysis.reconstruction.options import AUTO, Field, Light, Neighbours, Palette, Parallax, Power
from analysis.reflectance.dictionary import Dictionary, by_name, lambertian, parametric
from analysis.registration.grid import Grid
from analysis.registration.lighting import LightOffset, lit_from, looking_at_centre, theta_d_deg
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

MIN_PARALLAX_PX = 0.1
"""A shift of the views by less is not worth resampling them for."""

FAR_FIELD_DEG = 0.02
"""Directions that differ by less over the area are all the same."""

MIN_PIXELS = 400
"""A palette is not looked for in fewer."""

POWER_ERROR, POWER_GAIN = 0.004, 0.02
"""Spread of the views' power, and fall of the loss, from which on it is corrected: 0.1 % bends no normal."""

MAX_THETA_D_DEG = 5.0
"""Typical angle between camera or light and their bisector up to which a BRDF is taken for that on the slice
theta_d = 0: a light 60 mm beside a lens at 350 mm."""

NEIGHBOURS_WORTH = 0.9
"""Neighbours are asked where they take this share of the variance of the typical normal, or less, to be left."""

_FAR, _POWER_ROUNDS = 1e4, 3

_LIGHT_PIXELS = 128**2

_POWERS_DIFFER = 0.05  # standard deviation of log powers; where all are alike they are found to 0.02 or so

# Degrees a tangent axis for each degree of theta_d: of a glossy ball in a real dome [shi2016] with a Lambertian fit.
_THETA_D_ERROR = 0.12


@dataclass(frozen=True, slots=True)
class Powered:
    """A stack with the powers of its views, and the palette that was learnt with them; None without one."""

    stack: Stack
    palette: ScenePalette | None


@dataclass(frozen=True, slots=True)
class Lit:
    """A stack with the light in its place; `offset` is None where it was not estimated."""

    stack: Stack
    offset: LightOffset | None


def choose_dictionary(stack: Stack, name: str) -> Chosen[Dictionary]:
    """Take the dictionary that the options name, or the one that was made for light from where it comes.

    Atoms are fitted on the slice theta_d = 0, where camera and light stand side by side. Far from it a wrong highlight
    bends the normals more than none: a Lambertian surface is then fitted to samples without highlights.
    """
    if name != AUTO:
        return Chosen(by_name(name), Choice("dictionary", name, FORCED))
    theta_d = theta_d_deg(stack)
    middle, largest = float(np.median(theta_d)), float(theta_d.max())
    text = f"camera and light stand {middle:.1f} deg from their bisector in the typical view, {largest:.1f} at most"
    if middle <= MAX_THETA_D_DEG:
        return Chosen(parametric(), Choice("dictionary", "parametric", text))
    return Chosen(lambertian(), Choice("dictionary", "lambert", f"{text}; {MAX_THETA_D_DEG:g} is what atoms stand for"))


def theta_d_sigma(stack: Stack) -> float:
    """Return what a fit on the slice theta_d = 0 adds to the normals' error where theta_d is large, rad an axis."""
    theta_d = float(np.median(theta_d_deg(stack)))
    return float(np.deg2rad(_THETA_D_ERROR * theta_d)) if theta_d > MAX_THETA_D_DEG else 0.0


def choose_field(stack: Stack, field: Field) -> Chosen[Stack]:
    """Give every pixel its own directions, or that of the centre where they are the same."""
    corners = stack.grid.points()[[0, 0, -1, -1], [0, -1, 0, -1]]
    to_centre = stack.light_position / np.linalg.norm(stack.light_position, axis=1, keepdims=True)
    to_corner = stack.light_position[:, None] - corners
    to_corner /= np.linalg.norm(to_corner, axis=-1, keepdims=True)
    widest = float(np.rad2deg(np.max(np.linalg.norm(to_corner - to_centre[:, None], axis=-1))))
    near = widest > FAR_FIELD_DEG if field == "auto" else field == "near"
    text = f"directions to the light turn by up to {widest:.3g} deg between the centre and a corner"
    choice = Choice("field", "near" if near else "far", text if field == "auto" else FORCED)
    return Chosen(stack if near else far_field(stack), choice)


def far_field(stack: Stack) -> Stack:
    """Return the stack with camera and light so far away that every pixel has the centre's directions and fall-off."""
    return replace(
        stack,
        camera_position=_FAR * stack.camera_position,
        light_position=_FAR * stack.light_position,
        light_power=_FAR**2 * stack.light_power,
    )


def choose_palette(
    stack: Stack, dictionary: Dictionary, noise: Noise, palette: Palette, surface: bool, rng: np.random.Generator
) -> Chosen[ScenePalette | None]:
    """Find the scene's materials, unless its pixels have nothing in common."""
    against = _against_a_palette(stack, dictionary, palette, surface, rng)
    if against is not None:
        return _no_palette(against)
    scene = learn(stack, dictionary, noise, None, rng)
    if scene is None:
        return _no_palette(f"fewer than {MIN_SOLVED} pixels could be solved on their own")
    n, unfit = scene.found.palette.n_materials, 100.0 * scene.unfit_share
    losses = f"mean log(1 + loss) {scene.found.loss:.3f} with it, {scene.found.own_loss:.3f} of pixels on their own"
    if palette == "auto" and scene.unfit_share > NO_PALETTE_SHARE:
        return _no_palette(f"{unfit:.0f} % of the area is none of the {n} materials found; {losses}")
    noun = "material" if n == 1 else "materials"
    text = f"{losses}; {unfit:.0f} % of the area solved on its own"
    return Chosen(scene, Choice("palette", f"{n} {noun}", text))


def _against_a_palette(
    stack: Stack, dictionary: Dictionary, palette: Palette, surface: bool, rng: np.random.Generator
) -> str | None:
    """Return why none is looked for, or None."""
    if palette in {"off", "colour"}:
        return FORCED
    if not surface:
        return "independent pixels share no materials"
    if palette == "auto" and dictionary is lambertian():
        return "pixels are taken as Lambertian, each with its own albedo"
    n_pixels = len(sample_pixels(stack, MIN_PIXELS, rng))
    if palette == "auto" and n_pixels < MIN_PIXELS:
        return f"{n_pixels} pixels are too few to tell materials; {MIN_PIXELS} are enough"
    return None


def _no_palette(reason: str) -> Chosen[ScenePalette | None]:
    return Chosen(None, Choice("palette", "off", reason))


def choose_power(stack: Stack, scene: ScenePalette | None, noise: Noise, power: Power) -> Chosen[Powered]:
    """Correct each view's light power by what all pixels say, if it is off and the fit the better for it."""
    given = Powered(stack, scene)
    if scene is None:
        return Chosen(given, Choice("light power", "given", "without a palette nothing tells a view's power"))
    if power == "given":
        return Chosen(given, Choice("light power", "given", FORCED))
    corrected, better = stack, scene
    for _ in range(_POWER_ROUNDS):
        factor = better.power_factors(corrected)
        if np.std(factor) < POWER_ERROR / 4:
            break
        corrected = replace(corrected, light_power=corrected.light_power * factor)
        better = relearn(better, corrected, noise, None)
    ratio = corrected.light_power / stack.light_power
    off, gain = float(np.std(ratio / ratio.mean())), scene.found.loss - better.found.loss
    if off == 0.0:
        return Chosen(given, Choice("light power", "given", f"views are within {POWER_ERROR / 4:.1%} of it"))
    text = f"views differ by {off:.2%} from their stated power; corrected, the loss falls by {gain:.3f}"
    if power == "estimate" or (off > POWER_ERROR and gain > POWER_GAIN):
        return Chosen(Powered(corrected, better), Choice("light power", "per view", text))
    return Chosen(given, Choice("light power", "given", text))


def choose_light(stack: Stack, dictionary: Dictionary, light: Light, rng: np.random.Generator) -> Chosen[Lit]:
    """Place the light as the options say."""
    if light == "collocated":
        collocated = replace(stack, light_position=stack.camera_position)
        return Chosen(Lit(collocated, None), Choice("light", "collocated", FORCED))
    if light in {"auto", "given"}:
        distance = np.linalg.norm(stack.light_position - stack.camera_position, axis=1)
        text = f"{distance.mean():.2f} mm from the lens, as the stack says"
        chosen = "collocated" if distance.max() < 1e-6 else "offset"
        return Chosen(Lit(stack, None), Choice("light", chosen, text))
    if stack.camera_rotation is None:
        stack = replace(stack, camera_rotation=looking_at_centre(stack.camera_position))
    if stack.n_views < FEW_VIEWS:
        return light_by_plane(stack, offset_of_few_views(stack))
    found = pooled_light_offset(stack)
    noise = estimate_noise(lit_from(stack, found), dictionary, rng)
    found = estimate_light_offset(stack, dictionary, noise, LightOffset(found.value, np.full(3, np.inf)), rng)
    return Chosen(Lit(lit_from(stack, found), found), light_choice(found))


def offset_of_few_views(stack: Stack) -> LightOffset:
    """Find the light of a stack of few views, such that the mean normal is that of the plane.

    From the lens on: where the file puts the light is not asked.
    """
    collocated = replace(stack, light_position=stack.camera_position)
    offset = solve_few_views(collocated.binned(binning_for(stack, _LIGHT_PIXELS)), find_light=True).offset
    assert offset is not None
    return offset


def light_by_plane(stack: Stack, offset: LightOffset) -> Chosen[Lit]:
    """Put the light where the plane's mean normal has it."""
    return Chosen(Lit(lit_from(stack, offset), offset), light_choice(offset, "the plane's mean normal puts it"))


def light_is_unknown(stack: Stack, light: Light) -> bool:
    """Tell whether nobody said where the light stands, so that the plane may tell."""
    if light in {"given", "collocated"} or stack.camera_rotation is None:
        return False
    in_lens = np.allclose(stack.light_position, stack.camera_position)
    return light == "estimate" or (in_lens and stack.light_offset is None)


def found_powers(stack: Stack, few: FewViews) -> Chosen[Stack] | None:
    """Return the stack with the powers that were found with materials by colour; None where views hardly differ."""
    off = np.nan_to_num(few.log_power)
    if off.std() < _POWERS_DIFFER:
        return None
    return Chosen(replace(stack, light_power=stack.light_power * np.exp(off)), power_choice(few))


def light_is_uncertain(stack: Stack, light: Light) -> bool:
    """Tell whether the stack itself says that its light may stand elsewhere, and nothing forbids to look."""
    known = stack.camera_rotation is not None and stack.light_offset is not None
    enough = stack.n_views >= FEW_VIEWS
    return light == "auto" and enough and known and stack.light_offset_sigma is not None


def refine_light(
    stack: Stack, fitted: Stack, depth: Array, dictionary: Dictionary, noise: Noise, rng: np.random.Generator
) -> Chosen[Lit]:
    """Find the light again, now that the relief no longer blurs the highlights."""
    assert stack.light_offset is not None
    assert stack.light_offset_sigma is not None
    # What came before was found on the flat plane; its sigma does not know of the relief.
    prior = LightOffset(stack.light_offset, np.maximum(stack.light_offset_sigma, 1.0))
    found = estimate_light_offset(fitted, dictionary, noise, prior, rng, depth)
    return Chosen(Lit(lit_from(stack, found), found), light_choice(found))


def light_choice(found: LightOffset, who: str = "highlights put it") -> Choice:
    """Return where the light was found, for the record."""
    (x, y), (sigma_x, sigma_y) = found.value[:2], found.sigma[:2]
    text = f"{who} at ({x:.2f}, {y:.2f}) ± ({sigma_x:.2f}, {sigma_y:.2f}) mm from the lens"
    if float(np.hypot(x, y)) > 1.5 * TORCH_MM[1]:
        text += f"; a telephone's torch stands {TORCH_MM[0]:g} to {TORCH_MM[1]:g} mm from it: do not believe it"
    return Choice("light", "offset", text)


def may_be_few_views(stack: Stack, palette: Palette, *, surface: bool) -> bool:
    """Tell whether materials by colour may serve the scene better than those of pixels that were solved first."""
    if palette == "colour":
        return surface
    enough = stack.grid.height * stack.grid.width >= MIN_PIXELS
    collocated = float(np.median(theta_d_deg(stack))) <= MAX_THETA_D_DEG
    return palette == "auto" and surface and enough and collocated and stack.n_views < FEW_VIEWS


def choose_parallax(
    stack: Stack,
    depth: Array,
    dictionary: Dictionary,
    noise: Noise,
    parallax: Parallax,
    rng: np.random.Generator,
) -> Chosen[bool]:
    """Tell from the residuals whether the views are registered to the plane or already to the surface.

    A stack made on the plane fits best when resampled along the depth and worst against it; one made on the
    surface fits as badly either way. The two are compared with each other, since resampling itself smooths
    the noise and so lowers residuals, whichever its direction.
    """
    if parallax != "auto":
        return Chosen(parallax == "on", Choice("parallax", parallax, FORCED))
    pixels = sample_pixels(stack, 1500, rng)
    shift = np.linalg.norm(parallax_shift(stack, depth, pixels), axis=-1)
    largest = float(np.percentile(shift, 99))
    if largest < MIN_PARALLAX_PX:
        return Chosen(False, Choice("parallax", "off", f"the depth moves the views by {largest:.2f} pixels at most"))
    moved = np.sort(pixels[np.argsort(shift.max(axis=0))[len(pixels) // 2 :]])
    loss = {
        name: _log_loss(PixelProblem(stack, dictionary, moved, depth, samples), noise)
        for name, samples in (
            ("as is", None),
            ("along", follow_pixels(stack, depth, moved)),
            ("against", follow_pixels(stack, -depth, moved)),
        )
    }
    # Quadratic in the error of the shift: 0, z, 2 z along, as is, against on the plane; z, 0, z on the surface.
    follow = loss["against"] - loss["along"] > 0.5 * max(loss["against"] - loss["as is"], 0.0)
    text = (
        f"shift up to {largest:.1f} pixels; mean log loss {loss['as is']:.2f} as is, "
        f"{loss['along']:.2f} along the depth, {loss['against']:.2f} against it"
    )
    return Chosen(follow, Choice("parallax", "on" if follow else "off", text))


def choose_neighbours(
    fits: PixelFits,
    grid: Grid,
    material: NDArray[np.int64],
    neighbours: Neighbours,
    rng: np.random.Generator,
) -> Chosen[Told | None]:
    """Ask pixels' neighbours about their normals, unless these are known far better than neighbours are alike."""
    if neighbours == "off" or np.isfinite(fits.normals[:, 0]).sum() < MIN_PIXELS:
        reason = FORCED if neighbours == "off" else f"fewer than {MIN_PIXELS} pixels are solved"
        return Chosen(None, Choice("neighbours", "off", reason))
    told = ask_neighbours(fits, (grid.height, grid.width), material, rng)
    own = np.rad2deg(np.sqrt(told.inflation) * float(np.nanmedian(fits.normal_sigma)))
    spread = np.rad2deg(np.sqrt(told.inflation) * float(np.median(told.prior.sigma)))
    left = spread**2 / (spread**2 + own**2)
    text = (
        f"they tell a normal to {spread:.2g} deg a tangent axis, its own samples to {own:.2g}; "
        f"{smoother_text(told.smoother)}"
    )
    use = neighbours == "on" or left <= NEIGHBOURS_WORTH
    return Chosen(told if use else None, Choice("neighbours", "on" if use else "off", text))


def smoother_text(smoother: Smoother) -> str:
    """Return how a field is smoothed, for the record."""
    twice, within = ", twice" if smoother.twice else "", ", within a material" if smoother.within else ""
    return f"Gaussian of {smoother.width:g} pixels{twice}{within}, {smoother.gradient:.0%} towards a gradient field"


def power_choice(few: FewViews) -> Choice:
    """Return what was done with the powers of few views, for the record."""
    found = few.log_power[np.isfinite(few.log_power)]
    if not found.any():
        return Choice("light power", "given", "stated with the views, or forced by option")
    factors = ", ".join(f"{f:.2f}" for f in np.exp(found))
    return Choice("light power", "per view", f"found with all else, against those stated: {factors}")


def depth_has_settled(stack: Stack, used: Array, found: Array, follow: bool, n_updates: int) -> Chosen[bool]:
    """Tell whether the depth that was found moves anything against the one that it was found with, and how far.

    Parameters
    ----------
    stack : Stack
    used, found : ndarray, shape (H, W)
        Millimetres; NaN = hole.
    follow : bool
        Whether views are resampled along the depth.
    n_updates : int
        How many updates of the depth there were.
    """
    change = float(np.nanpercentile(np.abs(found - used), 99)) if np.isfinite(found - used).any() else 0.0
    turn = float(np.rad2deg(change / np.linalg.norm(stack.light_position, axis=1).min()))
    C = stack.camera_position
    shift = change * float(np.max(np.hypot(C[:, 0], C[:, 1]) / C[:, 2])) / stack.pixel_pitch if follow else 0.0
    text = f"another would turn directions by {turn:.2g} deg"
    if follow:
        text += f" and move the views by {shift:.2g} pixels"
    settled = turn < FAR_FIELD_DEG and shift < MIN_PARALLAX_PX
    return Chosen(settled, Choice("depth updates", str(n_updates), text))


def _log_loss(problem: PixelProblem, noise: Noise) -> float:
    # Not chi-square, which leaves out the views taken for wrong: those are the ones that moved.
    loss = problem.solve(noise).loss
    return float(np.mean(np.log(np.maximum(loss[np.isfinite(loss)], 1e-9))))
