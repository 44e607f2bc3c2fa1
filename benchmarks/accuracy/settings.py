"""What is run: scenes by the part of the benchmark that they belong to, and the methods on each."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from analysis.pixels.problem import Noise
from analysis.reconstruction.options import Options, Palette
from analysis.reflectance.atoms import LOBE, Atom
from analysis.reflectance.dictionary import Dictionary, parametric, published
from analysis.reflectance.models import Cosines
from benchmarks.accuracy import alterations
from benchmarks.accuracy.file_to_file import file_to_file
from benchmarks.common import scenes
from benchmarks.common.methods import (
    METHODS,
    Estimate,
    Method,
    generic,
    generic_pixels,
    known,
    palette,
    reference,
    whole,
)
from benchmarks.common.scenes import Scene

PARTS = {
    "independent": "unrelated pixels of all materials of a published table, by views and noise",
    "relief": "a relief of five materials, near field, light 12 mm from the lens, by views and noise",
    "variants": "the relief made harder",
    "poses": "other ways to go round the sample",
    "ablation": "what each modelled effect buys",
    "growth": "time and memory by pixels, views and atoms",
    "hard": "hard cases",
}

QUICK_PARTS = ("independent", "relief")

N_VIEWS, NOISE = 65, 0.02
"""The setting by which the targets are judged: the noisiest of all."""

GRID = tuple(product((10, 25, N_VIEWS, 100), (0.005, 0.01, NOISE)))
"""(views, noise) of the full run."""

QUICK_GRID = ((25, NOISE), (N_VIEWS, 0.005), (N_VIEWS, NOISE))

RELIEF_SIZE = 96  # pixels a side

TABLES = ("sgd", "abc")

LARGE_SIZE = 384

LARGE = f"{LARGE_SIZE**2} pixels"

MEGAPIXEL_SIZE = 1000

MEGAPIXEL = "a megapixel, from file to file"

REPEATS = 3  # reliefs of the settings of the targets, since one relief is one draw of five materials


@dataclass(frozen=True)
class Entry:
    """One method on a scene.

    Attributes
    ----------
    method : str
    solve : callable
    variant : str
        What is unusual about the method here.
    n_pixels : int or None
        Take only so many of independent pixels; None = all.
    """

    method: str
    solve: Method
    variant: str = ""
    n_pixels: int | None = None


@dataclass(frozen=True)
class Setting:
    """One scene and the methods on it.

    Attributes
    ----------
    part : str
        A key of `PARTS`.
    scene : {"independent", "relief"}
    entries : tuple of Entry
    size : int
        Pixels, of a relief those of a side.
    n_views, noise, table
        As of `benchmarks.common.scenes`.
    variant : str
        What is unusual about the scene.
    options : dict
        Further arguments of the scene.
    alter : callable or None
        Takes the scene and a generator, returns another scene.
    repeat : int
        Is added to the seed.
    """

    part: str
    scene: str
    entries: tuple[Entry, ...]
    size: int
    n_views: int = N_VIEWS
    noise: float = NOISE
    table: str = "sgd"
    variant: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    alter: Callable[[Scene, np.random.Generator], Scene] | None = None
    repeat: int = 0

    def make(self, seed: int) -> Scene:
        """Return the scene."""
        make = scenes.independent if self.scene == "independent" else scenes.relief
        scene: Scene = make(self.size, self.n_views, self.noise, seed + self.repeat, table=self.table, **self.options)
        return scene if self.alter is None else self.alter(scene, np.random.default_rng([seed + self.repeat, 1]))


def settings(*, quick: bool) -> Iterator[Setting]:
    """Yield all settings of the quick or the full benchmark, the quick ones being among the first parts only."""
    if quick:
        yield from independent_grid(QUICK_GRID, n_pixels=1024, n_reference=16, n_judged=40)
        yield from relief_grid(QUICK_GRID, repeats=1)
        return
    yield from independent_grid(GRID, n_pixels=2048, n_reference=48, n_judged=256)
    yield from relief_grid(GRID, REPEATS)
    yield from variants()
    yield from pose_sets()
    yield from ablation()
    yield from other_reference(n_pixels=96)
    yield from growth()
    yield from hard(n_pixels=1024)


def entries(*methods: str) -> tuple[Entry, ...]:
    """Return methods by their names."""
    return tuple(Entry(name, METHODS[name]) for name in methods)


def independent_grid(
    grid: tuple[tuple[int, float], ...], *, n_pixels: int, n_reference: int, n_judged: int
) -> Iterator[Setting]:
    """Yield independent pixels by (views, noise) and table; the reference takes `n_judged` where targets are judged."""
    for (n_views, noise), table in product(grid, TABLES):
        n = n_judged if (n_views, noise) == (N_VIEWS, NOISE) else n_reference
        slow = Entry("reference", METHODS["reference"], n_pixels=n)
        fast = entries("lambert", "trimmed", "generic", "known")
        yield Setting("independent", "independent", (slow, *fast), n_pixels, n_views, noise, table)


def other_reference(n_pixels: int) -> Iterator[Setting]:
    """Yield the reference with a dictionary of the scene's own kind, as the paper has it."""
    for table in TABLES:
        entry = Entry("reference", _reference_with(table), "the 99 other materials of the scene's own table")
        yield Setting("ablation", "independent", (entry,), n_pixels, table=table)


def relief_grid(grid: tuple[tuple[int, float], ...], repeats: int) -> Iterator[Setting]:
    """Yield reliefs by (views, noise); several where targets are judged."""
    methods = entries("trimmed", "generic", "palette", "known")
    for n_views, noise in grid:
        for repeat in range(repeats if (n_views, noise) == (N_VIEWS, NOISE) else 1):
            yield Setting("relief", "relief", methods, RELIEF_SIZE, n_views, noise, repeat=repeat)


def variants() -> Iterator[Setting]:
    """Yield reliefs that are harder, or in one way easier, than the usual one."""
    usual = Setting("variants", "relief", entries("trimmed", "generic", "palette", "known"), RELIEF_SIZE)
    for text, options, repeats in (
        ("light 60 mm off", {"offset_mm": 60.0}, REPEATS),
        ("10 % wrong samples", {"wrong": 0.1}, REPEATS),
        ("20 % wrong samples", {"wrong": 0.2}, 1),
        ("30 materials", {"n_materials": 30}, 1),
        ("one material", {"n_materials": 1}, 1),
        ("light power off by 1 % a view", {"power_error": 0.01}, 1),
    ):
        for repeat in range(repeats):
            yield replace(usual, variant=text, options=options, repeat=repeat)
    yield replace(usual, variant="materials of the other table", table="abc")
    # What is known of a palette does not help here: each pixel mixes more materials than a pixel may.
    gradients = entries("trimmed", "generic", "palette", "auto")
    yield replace(usual, variant="gradients, no palette", entries=gradients, options={"n_materials": 0})


def pose_sets() -> Iterator[Setting]:
    """Yield both scenes by the way the camera goes round."""
    for poses in scenes.POSES:
        usual = Setting("poses", "independent", entries("generic"), 1024, variant=poses, options={"poses": poses})
        yield usual
        yield replace(usual, n_views=25)
        yield replace(usual, scene="relief", entries=entries("generic", "palette"), size=RELIEF_SIZE)


def ablation() -> Iterator[Setting]:
    """Yield scenes with every effect modelled, and with each left out in turn."""
    usual = Setting("ablation", "relief", (), RELIEF_SIZE)
    yield replace(usual, entries=(*_single("off"), *_single("on")))
    corrected = tuple(
        Entry("palette", whole(options), text)
        for options, text in (
            (Options(palette="on"), "all effects"),
            (Options(palette="on", power="given"), "light power not corrected"),
        )
    )
    text = "light power off by 1 % a view"
    yield replace(usual, entries=corrected, variant=text, options={"power_error": 0.01})
    pixels = (
        Entry("generic", generic_pixels, "all effects"),
        Entry("generic", lambda scene: generic_pixels(scene, robust=False), "robust loss off"),
    )
    for wrong in (0.0, 0.1):
        text = f"flat, pixels on their own, {100 * wrong:.0f} % wrong samples"
        yield replace(usual, entries=pixels, variant=text, options={"wrong": wrong})
    more = (
        Entry("generic", _with_atoms(without_grazing_atoms()), "no grazing atoms"),
        Entry("generic", lambda scene: generic_pixels(scene, noise=Noise(1e-4, 1e-14)), "no model error"),
    )
    for table in TABLES:
        yield Setting("ablation", "independent", (*pixels, *more), 2048, table=table)


def _single(palette_option: Palette) -> Iterator[Entry]:
    """Yield whole solves with all effects, and without each in turn, with or without a palette."""
    method = "palette" if palette_option == "on" else "generic"
    base = Options(palette=palette_option)
    for text, options in (
        ("all effects", base),
        ("light taken for collocated", replace(base, light="collocated")),
        ("near field ignored", replace(base, field="far")),
        ("depth not fed back", replace(base, accuracy="draft")),
        ("depth fed back four times", replace(base, accuracy="best")),
        ("dictionary of measured materials", replace(base, dictionary="abc")),
    ):
        yield Entry(method, whole(options), text)
    if palette_option == "off":
        yield Entry(method, whole(replace(base, parallax="on")), "parallax forced")
        yield Entry(method, _on(alterations.without_variance), "variance not given")


def growth() -> Iterator[Setting]:
    """Yield the same scene in several sizes, with the memory that is taken."""
    methods = tuple(Entry(e.method, with_memory(e.solve)) for e in entries("generic", "palette"))
    for size in (48, 96, 192):
        yield Setting("growth", "relief", methods, size, variant=f"{size**2} pixels")
    large = (Entry("palette", with_memory(palette)),)
    yield Setting("growth", "relief", large, LARGE_SIZE, variant=LARGE)
    yield Setting("growth", "relief", (Entry("palette", file_to_file),), MEGAPIXEL_SIZE, variant=MEGAPIXEL)
    pixels = (Entry("generic", with_memory(generic_pixels)),)
    for n_views in (16, 32, N_VIEWS, 130, 260):
        yield Setting("growth", "independent", pixels, 2048, n_views, variant=f"{n_views} views")
    for n_widths, n_gammas in ((7, 2), (14, 3), (28, 6), (56, 6)):
        dictionary = fine_dictionary(n_widths, n_gammas)
        text = f"{len(dictionary.atoms)} atoms"
        entry = Entry("generic", with_memory(_with_atoms(dictionary)))
        yield Setting("growth", "independent", (entry,), 2048, variant=text)


def hard(n_pixels: int) -> Iterator[Setting]:
    """Yield the hard cases, most of them of independent pixels."""
    methods = entries("trimmed", "generic")
    plain = Setting("hard", "independent", methods, n_pixels)
    yield replace(plain, variant="nothing special")
    for text, options in (
        ("near-mirrors", {"materials": sharpest("sgd", 10)}),
        ("very dark: floor 6 % of the median", {"floor": 0.06}),
        ("normals tilted by 45 to 65 deg", {"narrowest_normal_deg": 45.0, "widest_normal_deg": 65.0}),
        ("two materials a pixel", {"mixed": True}),
        ("blurred over normals 3 deg off", {"blur_deg": 3.0}),
        ("noise-free, float32", {"floor": 1e-6}),
    ):
        noise = 1e-6 if text.startswith("noise-free") else NOISE
        yield replace(plain, variant=text, options=options, noise=noise)
    for n_views in (4, 6, 8):
        yield replace(plain, variant="few views", n_views=n_views)
    for text, alter in (
        ("clipped at 3 times the median", lambda scene, _: alterations.clipped(scene, 3.0)),
        ("10 % wrong samples", lambda scene, rng: alterations.spoilt(scene, 0.1, rng)),
        ("20 % wrong samples", lambda scene, rng: alterations.spoilt(scene, 0.2, rng)),
        ("light power off by 1 % a view", lambda scene, rng: alterations.with_gain_errors(scene, 0.01, rng)),
        ("light power off by 3 % a view", lambda scene, rng: alterations.with_gain_errors(scene, 0.03, rng)),
    ):
        yield replace(plain, variant=text, alter=alter)
    for theta_d in (1.0, 2.0, 5.0):
        offset = replace(plain, options={"theta_d_deg": theta_d})
        yield replace(offset, variant=f"theta_d {theta_d:.0f} deg, known")
        yield replace(
            offset,
            variant=f"theta_d {theta_d:.0f} deg, taken for collocated",
            alter=lambda scene, _: alterations.without_offset(scene),
        )
    near_copies = fine_dictionary(56, 6)
    text = f"ill-conditioned dictionary: {len(near_copies.atoms)} atoms, near-copies of each other"
    yield replace(plain, variant=text, entries=(Entry("generic", _with_atoms(near_copies)),))
    relief = Setting("hard", "relief", (*methods, Entry("known", known)), 64)
    yield replace(relief, variant="plane at 350 mm, noise-free", noise=1e-6, options={"steepness": 0.0, "floor": 1e-6})
    yield replace(
        relief,
        variant="distance stated 5 % too large",
        entries=methods,
        alter=lambda scene, _: alterations.at_wrong_distance(scene, 1.05),
    )


def with_memory(solve: Method) -> Method:
    """Return the method with the memory that it takes, from a second run that is not timed."""

    def measured(scene: Scene) -> Estimate:
        estimate = solve(scene)
        tracemalloc.start()
        try:
            solve(scene)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        stack_mb = scene.stack.radiance.nbytes / 1e6
        return replace(estimate, notes=estimate.notes | {"peak_mb": peak / 1e6, "radiance_mb": stack_mb})

    return measured


def fine_dictionary(n_widths: int, n_gammas: int) -> Dictionary:
    """Return a parametric dictionary with more, or fewer, lobes than the usual one."""
    lobes = [
        Atom(LOBE, float(width), float(gamma))
        for width in np.deg2rad(np.geomspace(0.7, 38.0, n_widths))
        for gamma in np.geomspace(1.0, 6.0, n_gammas)
    ]
    rest = [atom for atom in parametric().atoms if atom.kind != LOBE]
    return Dictionary(f"parametric, {n_widths} x {n_gammas}", (*rest, *lobes))


def without_grazing_atoms() -> Dictionary:
    """Return the parametric dictionary without what it has for grazing angles."""
    kept = [a for a in parametric().atoms if a.kind == LOBE or a.name in {"lambert", "cosine", "rim"}]
    return Dictionary("parametric, not grazing", tuple(kept))


def sharpest(table: str, n: int) -> Any:
    """Return the rows of the `n` materials whose curve is highest at the peak against that at 45 deg."""
    rows = scenes.material_rows(table)
    dictionary = [Atom(table, float(row), 1.0) for row in rows]
    angles = Cosines.on_slice(np.deg2rad(np.array([0.0, 45.0])))
    peak, side = np.stack([atom.evaluate(angles) for atom in dictionary], axis=1)
    assert len(published(table)) >= n
    return rows[np.argsort(-peak / np.maximum(side, 1e-9))[:n]]


def _with_atoms(dictionary: Dictionary) -> Method:
    """Return the generic method on pixels with another dictionary."""
    return lambda scene: generic_pixels(scene, dictionary)


def _reference_with(table: str) -> Method:
    return lambda scene: reference(scene, table)


def _on(alter: Callable[[Scene], Scene]) -> Method:
    """Return the generic method on a scene that was altered."""
    return lambda scene: generic(alter(scene))
