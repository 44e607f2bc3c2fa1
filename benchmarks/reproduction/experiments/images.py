"""Fig. 3: errors of normal and BRDF against the number of images, over all materials with random normals each.

Normals are those of the program's own pixel solver with the dictionary of the other materials, on all pixels; and on
a few those of the slow reference, which searches over candidates with plain NNLS in the manner of the paper.

For the BRDF the true normal is given, as in the supplement, where the number of images is that of the half angles: one
at random in each of as many equal steps of the root of theta_h. The half angles of real images are those that the
normal leaves; from these it is estimated as well, and scored in the logarithm, since most miss a narrow highlight.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from analysis.evaluation.metrics import angular_error_deg
from analysis.pixels.problem import PixelProblem
from analysis.reflectance.completion import MIN_SAMPLES, atoms_on_slice
from analysis.reflectance.dictionary import Dictionary
from benchmarks.common.reference import atom_table, pixel_samples, solve_pixel
from benchmarks.common.scenes import scattered
from benchmarks.reproduction.brdf_domain import LOWEST_ELEVATION_DEG, Domain
from benchmarks.reproduction.brdf_materials import Angles, Bank, Collection, collections
from benchmarks.reproduction.brdf_methods.case import MAX_DEG
from benchmarks.reproduction.brdf_methods.dictionary_fit import coefficients
from benchmarks.reproduction.brdf_methods.univariate import complete_channels
from benchmarks.reproduction.experiment import Experiment, Finding, Request, Row, Verdict
from benchmarks.reproduction.figures import drawn
from benchmarks.reproduction.material_pixels import MaterialPixels

Array = NDArray[np.float64]

COUNTS = (6, 10, 15, 25, 40, 65, 100)

REFERENCE_COUNTS = (10, 25, 65)
"""Of the slow reference, and of the BRDF from real images."""

NOISE = 0.01

MODEL_ERROR = 0.01
"""Relative, that the solver expects of the dictionary beyond the noise."""

MAX_NORMAL_DEG = 35.0

STEEPEST = 1.5
"""Errors that grow no faster than the number of images to the power of -1.5 degrade gracefully."""

COMPARED_TO_DEG = 45.0

NORMAL, REFERENCE = "normal, ours", "normal, reference"

OURS, PLAIN = "BRDF, ours, relative", "BRDF, plain NNLS, relative"

OURS_LOG, PLAIN_LOG = "BRDF from images, ours, log-cosine", "BRDF from images, plain NNLS, log-cosine"

UNITS = {NORMAL: "deg", REFERENCE: "deg", OURS: "1", PLAIN: "1", OURS_LOG: "1", PLAIN_LOG: "1"}


@dataclass(frozen=True)
class Size:
    """How much is run: materials, normals each, draws of the BRDF each, materials (one pixel each) of the reference."""

    n_materials: int | None
    n_normals: int
    n_brdf: int
    n_reference_materials: int


WHOLE = Size(None, 100, 6, 33)

QUICK = Size(20, 30, 1, 4)


def run(request: Request) -> Finding:
    """Solve all pixels for each number of images."""
    size = QUICK if request.quick else WHOLE
    rows = [row for c in collections(request, size.n_materials) for row in _rows(c, size, request.seed)]
    steepest = {
        (what, statistic): max(steepness(rows, source, what, statistic) for source in _sources(rows))
        for what in (NORMAL, OURS)
        for statistic in ("mean", "median")
    }
    graceful = max(steepest[NORMAL, "mean"], steepest[OURS, "median"]) <= STEEPEST
    return Finding(
        ours="; ".join(f"{source}: {_summary(rows, source)}" for source in _sources(rows)),
        verdict=Verdict.EQUAL if graceful else Verdict.WORSE,
        why=_why(rows, size, steepest, measured=request.merl is not None),
        rows=rows,
        figures=[_figure(rows, request.folder / "images.png")],
    )


def _why(rows: list[Row], size: Size, steepest: dict[tuple[str, str], float], *, measured: bool) -> str:
    return (
        "Graceful means that the mean error of normals and the median error of BRDFs never grow faster than the number "
        f"of images to the power of -{STEEPEST} over two steps of that number; the steepest powers are "
        f"{-steepest[NORMAL, 'mean']:.2f} and {-steepest[OURS, 'median']:.2f}. (The mean of BRDFs, whose power is "
        f"{-steepest[OURS, 'mean']:.2f}, is that of the few whose highlight is missed.) {size.n_normals} normals a "
        f"material within {MAX_NORMAL_DEG:.0f} deg, {size.n_brdf} draws for the BRDF, {100 * NOISE:.0f} % noise; "
        "the supplement takes 100 and shows errors in plots only. Half angles of real images, with normals given, say "
        f"much less of narrow highlights: the RMS log-cosine of the BRDF is then {_logarithmic(rows)}."
        + ("" if measured else " Fits are smoother than measurements.")
    )


def _rows(collection: Collection, size: Size, seed: int) -> Iterator[Row]:
    """Yield a row for each quantity and number of images."""
    errors: dict[tuple[str, int], list[float]] = {(what, n): [] for what in UNITS for n in COUNTS}
    for what, n_images, found in _errors(collection, size, seed):
        errors[what, n_images].extend(found)
    for (what, n_images), values in errors.items():
        if values:
            yield _row(collection.source, what, n_images, np.array(values))


def _row(source: str, what: str, n_images: int, values: Array) -> Row:
    finite = values[np.isfinite(values)]
    return {
        "materials": source,
        "what": what,
        "unit": UNITS[what],
        "n_images": n_images,
        "n_pixels": len(values),
        "n_unsolved": len(values) - len(finite),
        "mean": float(finite.mean()),
        "median": float(np.median(finite)),
        "p95": float(np.percentile(finite, 95)),
    }


def _errors(collection: Collection, size: Size, seed: int) -> Iterator[tuple[str, int, list[float]]]:
    """Yield what is in error, the number of images, and the errors of some pixels."""
    domain = Domain.whole()
    bank = Bank(collection, {"domain": domain.angles})
    step = max(len(collection.tested) // size.n_reference_materials, 1)
    for i, (material, dictionary) in enumerate(collection.trials()):
        # The same for all numbers of images.
        normals = scattered(size.n_normals, np.random.default_rng([seed, i]), MAX_NORMAL_DEG)
        scorer = _BrdfScorer(
            domain, bank.truth(material.name, "domain"), bank.atoms("domain", material.name), dictionary
        )
        for n_images in COUNTS:
            rng = np.random.default_rng([seed, i, n_images])
            seen = MaterialPixels.of(material, normals, n_images, NOISE, rng)
            yield NORMAL, n_images, _angular_errors(seen, dictionary)
            for pixel in range(size.n_brdf):
                theta_h = half_angles(n_images, rng)
                curve = material.brdf.at(Angles.of(theta_h))
                noisy = curve * (1.0 + NOISE * rng.standard_normal(curve.shape))
                ours, plain = scorer.estimates(theta_h, noisy)
                yield OURS, n_images, [scorer.relative(ours)]
                yield PLAIN, n_images, [scorer.relative(plain)]
                if n_images not in REFERENCE_COUNTS:
                    continue
                theta_h, curve = seen.curve(pixel, np.sin(np.deg2rad(LOWEST_ELEVATION_DEG)))
                ours, plain = scorer.estimates(theta_h, curve)
                yield OURS_LOG, n_images, [scorer.logarithmic(ours)]
                yield PLAIN_LOG, n_images, [scorer.logarithmic(plain)]
            if n_images in REFERENCE_COUNTS and i % step == 0:
                found = solve_pixel(pixel_samples(seen.stack, 0), atom_table(dictionary))
                yield REFERENCE, n_images, [float(angular_error_deg(found.normal, normals[0]))]


def _angular_errors(seen: MaterialPixels, dictionary: Dictionary) -> list[float]:
    fits = PixelProblem(seen.stack, dictionary).solve(seen.noise(MODEL_ERROR))
    return list(angular_error_deg(fits.normals, seen.normals))


@dataclass(frozen=True, eq=False)
class _BrdfScorer:
    """Scores estimates of one material."""

    domain: Domain
    truth: Array
    atoms: Array
    dictionary: Dictionary

    def estimates(self, theta_h: Array, curve: Array) -> tuple[Array, Array]:
        """Return ours and that of plain NNLS at the nodes, shape (n, 3); NaN from too few samples."""
        if len(theta_h) < MIN_SAMPLES:
            return np.full_like(self.truth, np.nan), np.full_like(self.truth, np.nan)
        plain = self.atoms @ coefficients(atoms_on_slice(self.dictionary.atoms, theta_h).T, curve)
        tables = complete_channels(theta_h, curve, self.dictionary, NOISE)
        return np.stack([self.domain.from_table(table) for table in tables], axis=1), plain

    def relative(self, estimate: Array) -> float:
        return self.domain.relative_error(estimate, self.truth, self.domain.up_to(COMPARED_TO_DEG))

    def logarithmic(self, estimate: Array) -> float:
        return self.domain.log_error(estimate, self.truth, self.domain.up_to(COMPARED_TO_DEG))


def half_angles(n: int, rng: np.random.Generator) -> Array:
    """Return `n` half angles (rad) up to the largest that is relied on, one in each equal step of their root."""
    return np.asarray(np.deg2rad(MAX_DEG) * ((np.arange(n) + rng.random(n)) / n) ** 2)


def _sources(rows: list[Row]) -> list[str]:
    return list(dict.fromkeys(str(row["materials"]) for row in rows))


def _series(rows: list[Row], source: str, what: str, statistic: str) -> tuple[Array, Array]:
    """Return numbers of images and errors."""
    found = [row for row in rows if (row["materials"], row["what"]) == (source, what)]
    return np.array([row["n_images"] for row in found], float), np.array([row[statistic] for row in found])


def steepness(rows: list[Row], source: str, what: str, statistic: str) -> float:
    """Return the largest -d log(error) / d log(number of images) over two steps of the number."""
    n_images, error = _series(rows, source, what, statistic)
    return float(np.max(np.log(error[:-2] / error[2:]) / np.log(n_images[2:] / n_images[:-2])))


def _summary(rows: list[Row], source: str) -> str:
    def of(what: str) -> str:
        n_images, mean = _series(rows, source, what, "mean")
        median = _series(rows, source, what, "median")[1]
        chosen = [i for i, n in enumerate(n_images) if n in REFERENCE_COUNTS]
        return ", ".join(f"{mean[i]:.2g} / {median[i]:.2g} at {n_images[i]:.0f}" for i in chosen)

    return (
        f"normals, mean / median deg: {of(NORMAL)} images (reference {of(REFERENCE)}); "
        f"relative error of the BRDF to theta_d = {COMPARED_TO_DEG:.0f} deg: {of(OURS)} (plain NNLS {of(PLAIN)})"
    )


def _logarithmic(rows: list[Row]) -> str:
    first, last = (
        np.mean([_series(rows, source, OURS_LOG, "median")[1][i] for source in _sources(rows)]) for i in (0, -1)
    )
    return f"{first:.1f} from {REFERENCE_COUNTS[0]} and {last:.1f} from {REFERENCE_COUNTS[-1]} images (median)"


def _figure(rows: list[Row], path: Path) -> Path:
    sources = _sources(rows)
    with drawn(path, 1, 2 * len(sources), 4.2 * len(sources) + 1.0, 3.2) as axes:
        for column, source in enumerate(sources):
            left, right = axes[0, 2 * column], axes[0, 2 * column + 1]
            _draw(left, rows, source, {NORMAL: "black", REFERENCE: "C1"})
            _draw(right, rows, source, {OURS: "black", PLAIN: "C1"})
            left.set_ylabel("angular error, deg")
            right.set_ylabel(f"relative BRDF error, theta_d to {COMPARED_TO_DEG:.0f} deg")
            left.set_title(source.replace(", ", ",\n"))
    return path


def _draw(axes: Axes, rows: list[Row], source: str, colours: dict[str, str]) -> None:
    for what, colour in colours.items():
        for statistic, style in (("mean", "-o"), ("median", "--")):
            axes.plot(
                *_series(rows, source, what, statistic),
                style,
                color=colour,
                label=f"{what.removesuffix(', relative')}, {statistic}",
            )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(COUNTS, [str(n) for n in COUNTS])
    axes.minorticks_off()
    axes.set_xlabel("images")
    axes.legend()


EXPERIMENT = Experiment(
    name="images",
    source="fig. 3",
    title="Angular error of normals and relative BRDF error against the number of images",
    stated="Both errors degrade gracefully with fewer images (numbers in plots only).",
    run=run,
)
