"""Fig. 3: errors of normal and BRDF against the number of images, over all materials with random normals each.

Normals are those of the program's own pixel solver with the dictionary of the other materials, on all pixels; and on
a few those of the slow reference, which searches over candidates with plain NNLS in the manner of the paper. For the
BRDF the true normal is given, as in the supplement: ours and plain NNLS, from what a pixel's images show of the slice.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from analysis.dictionary import Dictionary
from analysis.extrapolation import MIN_SAMPLES, atoms_on_slice
from analysis.fitting import PixelProblem
from analysis.metrics import angular_error_deg
from benchmarks.brdf_domain import LOWEST_ELEVATION_DEG, Domain
from benchmarks.brdf_materials import Bank, Collection, collections
from benchmarks.brdf_methods.dictionary_fit import coefficients
from benchmarks.brdf_methods.univariate import complete_channels
from benchmarks.experiment import Experiment, Finding, Request, Row, Verdict
from benchmarks.experiment_figures import drawn
from benchmarks.material_pixels import MaterialPixels
from benchmarks.reference import atom_table, pixel_samples, solve_pixel
from benchmarks.scenes import scattered

Array = NDArray[np.float64]

COUNTS = (6, 8, 10, 15, 25, 40, 65, 100)
REFERENCE_COUNTS = (10, 25, 65)
NOISE = 0.01
MODEL_ERROR = 0.01
"""Relative, that the solver expects of the dictionary beyond the noise."""

WIDEST_NORMAL_DEG = 35.0
STEEPEST = 1.5
"""Errors that grow no faster than the number of images to the power of -1.5, step by step, degrade gracefully."""

COMPARED_TO_DEG = 45.0

NORMAL, REFERENCE = "normal, ours", "normal, reference"
OURS, PLAIN = "BRDF, ours, log-cosine", "BRDF, plain NNLS, log-cosine"
OURS_RELATIVE, PLAIN_RELATIVE = "BRDF, ours, relative", "BRDF, plain NNLS, relative"
UNITS = {NORMAL: "deg", REFERENCE: "deg", OURS: "1", PLAIN: "1", OURS_RELATIVE: "1", PLAIN_RELATIVE: "1"}


@dataclass(frozen=True)
class Size:
    """How much is run: materials, normals a material, of these for the BRDF, materials (one pixel) for the reference."""

    n_materials: int | None
    n_normals: int
    n_brdf_normals: int
    n_reference_materials: int


WHOLE = Size(None, 100, 6, 33)
QUICK = Size(25, 30, 1, 4)


def run(request: Request) -> Finding:
    """Solve all pixels for each number of images."""
    size = QUICK if request.quick else WHOLE
    rows = [row for c in collections(request, size.n_materials) for row in _rows(c, size, request.seed)]
    steepest = {what: max(steepness(rows, source, what) for source in _sources(rows)) for what in (NORMAL, OURS)}
    graceful = max(steepest.values()) <= STEEPEST
    return Finding(
        ours="; ".join(f"{source}: {_summary(rows, source)}" for source in _sources(rows)),
        verdict=Verdict.EQUAL if graceful else Verdict.WORSE,
        why=(
            "Graceful means that the mean error never grows faster than the number of images to the power of "
            f"-{STEEPEST} from one number to the next; the steepest powers are {-steepest[NORMAL]:.2f} (normals) and "
            f"{-steepest[OURS]:.2f} (BRDF). {size.n_normals} normals a material within {WIDEST_NORMAL_DEG:.0f} deg, "
            f"{size.n_brdf_normals} of them for the BRDF, {100 * NOISE:.0f} % noise; the supplement takes 100 and "
            "shows errors in plots only. The BRDF's error is that of the log-cosine: its relative error (in the table) "
            "is that of the top of highlights narrower than the images lie apart, which no image shows."
            + ("" if request.merl else " Fits are smoother than measurements.")
        ),
        rows=rows,
        figures=[_figure(rows, request.folder / "images.png")],
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
        normals = scattered(size.n_normals, np.random.default_rng([seed, i]), WIDEST_NORMAL_DEG)
        scorer = _BrdfScorer(
            domain, bank.truth(material.name, "domain"), bank.atoms("domain", material.name), dictionary
        )
        for n_images in COUNTS:
            rng = np.random.default_rng([seed, i, n_images])
            seen = MaterialPixels.of(material, normals, n_images, NOISE, rng)
            yield NORMAL, n_images, _angular_errors(seen, dictionary)
            for pixel in range(size.n_brdf_normals):
                for what, error in scorer.errors(seen, pixel).items():
                    yield what, n_images, [error]
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

    def errors(self, seen: MaterialPixels, pixel: int) -> dict[str, float]:
        """Return the errors of both estimates from one pixel's images, its normal given; NaN if these are too few."""
        theta_h, curve = seen.curve(pixel, np.sin(np.deg2rad(LOWEST_ELEVATION_DEG)))
        if len(theta_h) < MIN_SAMPLES:
            return dict.fromkeys((OURS, PLAIN, OURS_RELATIVE, PLAIN_RELATIVE), float("nan"))
        plain = self.atoms @ coefficients(atoms_on_slice(self.dictionary.atoms, theta_h).T, curve)
        tables = complete_channels(theta_h, curve, self.dictionary, NOISE)
        ours = np.stack([self.domain.from_table(table) for table in tables], axis=1)
        near = self.domain.up_to(COMPARED_TO_DEG)
        return {
            OURS: self.domain.log_error(ours, self.truth, near),
            PLAIN: self.domain.log_error(plain, self.truth, near),
            OURS_RELATIVE: self.domain.relative_error(ours, self.truth, near),
            PLAIN_RELATIVE: self.domain.relative_error(plain, self.truth, near),
        }


def _sources(rows: list[Row]) -> list[str]:
    return list(dict.fromkeys(str(row["materials"]) for row in rows))


def _series(rows: list[Row], source: str, what: str, statistic: str) -> tuple[Array, Array]:
    """Return numbers of images and errors."""
    found = [row for row in rows if (row["materials"], row["what"]) == (source, what)]
    return np.array([row["n_images"] for row in found], float), np.array([row[statistic] for row in found])


def steepness(rows: list[Row], source: str, what: str) -> float:
    """Return the largest -d log(mean error) / d log(number of images) from one number to the next."""
    n_images, error = _series(rows, source, what, "mean")
    return float(np.max(-np.diff(np.log(error)) / np.diff(np.log(n_images))))


def _summary(rows: list[Row], source: str) -> str:
    def of(what: str) -> str:
        n_images, mean = _series(rows, source, what, "mean")
        median = _series(rows, source, what, "median")[1]
        chosen = [i for i, n in enumerate(n_images) if n in REFERENCE_COUNTS]
        return ", ".join(f"{mean[i]:.2g} / {median[i]:.2g} at {n_images[i]:.0f}" for i in chosen)

    return (
        f"normals, mean / median deg: {of(NORMAL)} images (reference {of(REFERENCE)}); "
        f"RMS log-cosine of the BRDF to theta_d = {COMPARED_TO_DEG:.0f} deg: {of(OURS)} (plain NNLS {of(PLAIN)})"
    )


def _figure(rows: list[Row], path: Path) -> Path:
    sources = _sources(rows)
    with drawn(path, 1, 2 * len(sources), 4.2 * len(sources) + 1.0, 3.2) as axes:
        for column, source in enumerate(sources):
            left, right = axes[0, 2 * column], axes[0, 2 * column + 1]
            _draw(left, rows, source, {NORMAL: "black", REFERENCE: "C1"})
            _draw(right, rows, source, {OURS: "black", PLAIN: "C1"})
            left.set_ylabel("angular error, deg")
            right.set_ylabel(f"RMS log-cosine of the BRDF, theta_d to {COMPARED_TO_DEG:.0f} deg")
            left.set_title(source.replace(", ", ",\n"))
    return path


def _draw(axes: Axes, rows: list[Row], source: str, colours: dict[str, str]) -> None:
    for what, colour in colours.items():
        for statistic, style in (("mean", "-o"), ("median", "--")):
            axes.plot(
                *_series(rows, source, what, statistic),
                style,
                color=colour,
                label=f"{what.removesuffix(', log-cosine')}, {statistic}",
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
