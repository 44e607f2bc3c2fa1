"""How well the BRDF is known beyond what was seen of its slice: python -m benchmarks.studies.beyond_slice.

Each of the 100 materials of one published table is completed with the other table, without the material
of that name, by several estimators; then with its own table, which says what the stated band is worth
where the dictionary is of the truth's own kind. One channel a material, in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from time import perf_counter

import click
import numpy as np
from scipy.optimize import nnls

from analysis.reflectance.atoms import AnyAtom
from analysis.reflectance.completion import (
    THETA_D,
    THETA_H,
    CompletedBrdf,
    atom_on_nodes,
    atoms_on_slice,
    complete_brdf,
)
from analysis.reflectance.dictionary import Dictionary, from_published
from analysis.reflectance.models import Array

MIN_DEG, N_SAMPLES = 1.0, 65

LOWEST_ELEVATION = float(np.cos(np.deg2rad(80.0)))
"""Cosine of light and view below which a cell is not scored."""

Estimator = Callable[[Array, Array, Array, Dictionary], CompletedBrdf]


def nnls_with(weight: Callable[[Array, Array], Array]) -> Estimator:
    """Return non-negative least squares on the seen slice, samples weighted by `weight(curve, sigma)`."""

    def complete(theta_h: Array, curve: Array, sigma: Array, dictionary: Dictionary) -> CompletedBrdf:
        w = weight(curve, sigma)
        on_slice = atoms_on_slice(dictionary.atoms, theta_h)
        coefficient, _ = nnls((on_slice * w).T, curve * w)
        value = sum(c * atom_on_nodes(atom) for c, atom in zip(coefficient, dictionary.atoms, strict=True) if c > 0.0)
        return CompletedBrdf(THETA_H, THETA_D, np.asarray(value), np.full((len(THETA_H), len(THETA_D)), np.nan))

    return complete


ESTIMATORS: dict[str, Estimator] = {
    "NNLS": nnls_with(lambda curve, sigma: np.ones_like(curve)),
    "NNLS, Poisson": nnls_with(lambda curve, sigma: 1.0 / np.sqrt(np.maximum(curve, 1e-3 * curve.max()))),
    "NNLS, by sigma": nnls_with(lambda curve, sigma: 1.0 / sigma),
    "Gaussian prior": complete_brdf,
}


@dataclass(frozen=True)
class Trial:
    """One setting: which table is the dictionary, which the truth, how far and how well the slice is seen."""

    dictionary: str
    truth: str
    largest_deg: float
    noise: float


def trials() -> Iterator[Trial]:
    """Yield the settings."""
    for dictionary, truth in (("sgd", "abc"), ("abc", "sgd"), ("sgd", "sgd"), ("abc", "abc")):
        for largest in (50.0, 70.0):
            for noise in (0.01, 0.05):
                yield Trial(dictionary, truth, largest, noise)


def regions(largest_deg: float) -> dict[str, Array]:
    """Return which nodes are scored together, by the name of the region."""
    high = np.cos(THETA_H)[:, None] * np.cos(THETA_D) > LOWEST_ELEVATION
    theta_h, theta_d = np.rad2deg(THETA_H)[:, None], np.rad2deg(THETA_D)
    outside = (theta_h > largest_deg) | (theta_h < MIN_DEG)
    return {
        "0-20": high & (theta_d > 0.0) & (theta_d < 20.0),
        "20-50": high & (theta_d >= 20.0) & (theta_d < 50.0),
        "50-75": high & (theta_d >= 50.0) & (theta_d <= 75.0),
        "slice, unseen": high & (theta_d == 0.0) & outside,
    }


def run(trial: Trial, estimator: Estimator, step: int = 1) -> tuple[Array, Array, Array, float]:
    """Complete every `step`-th material; return estimates, truths, log sigmas and seconds a material."""
    rng = np.random.default_rng(0)
    theta_h = np.deg2rad(np.linspace(MIN_DEG, trial.largest_deg, N_SAMPLES))
    atoms = from_published(trial.truth).atoms
    tested = [atoms[3 * i + i % 3] for i in range(0, len(atoms) // 3, step)]
    completed, seconds = [], 0.0
    for atom in tested:
        others = without(trial.dictionary, atom.name)
        curve = atoms_on_slice((atom,), theta_h)[0]
        measured = curve * np.maximum(1.0 + trial.noise * rng.standard_normal(len(theta_h)), 1e-3)
        begin = perf_counter()
        completed.append(estimator(theta_h, measured, trial.noise * measured, others))
        seconds += perf_counter() - begin
    truth = np.stack([atom_on_nodes(atom) for atom in tested])
    return (
        np.stack([c.value for c in completed]),
        truth,
        np.stack([c.log_sigma for c in completed]),
        seconds / len(tested),
    )


@cache
def without(table: str, name: str) -> Dictionary:
    """Return a published table without the material `name`, its nodes evaluated beforehand."""
    atoms: tuple[AnyAtom, ...] = tuple(atom for atom in from_published(table).atoms if atom.name != name)
    for atom in atoms:
        atom_on_nodes(atom)
    atoms_on_slice(atoms, np.zeros(1))
    return Dictionary(table, atoms)


def scores(value: Array, truth: Array, log_sigma: Array, largest_deg: float) -> list[str]:
    """Return median / mean relative error and coverage of the 68 and 95 % bands for each region."""
    error, log_error = np.abs(value / truth - 1.0), np.abs(np.log(np.maximum(value, 1e-12) / truth))
    texts = []
    for region in regions(largest_deg).values():
        text = f"{100 * np.median(error[:, region]):.1f} / {100 * np.mean(error[:, region]):.0f}"
        if np.isfinite(log_sigma).all():
            inside = [100 * np.mean((log_error < k * log_sigma)[:, region]) for k in (1.0, 1.96)]
            text += f" ({inside[0]:.0f}, {inside[1]:.0f})"
        texts.append(text)
    return texts


@click.command()
@click.option("--step", type=click.IntRange(min=1), default=1, show_default=True, help="Take every n-th material.")
def main(step: int) -> None:
    """Print the table of docs/beyond-the-slice.md."""
    names = list(regions(50.0))
    click.echo("Relative error in %, median / mean, and how many % of the truths the 68 and the 95 % band hold.\n")
    click.echo("| dictionary, truth | seen to, noise | estimator | " + " | ".join(names) + " | ms |")
    click.echo("|---" * (len(names) + 4) + "|")
    for trial in trials():
        for name, estimator in ESTIMATORS.items():
            if trial.dictionary == trial.truth and estimator is not complete_brdf:
                continue
            value, truth, log_sigma, seconds = run(trial, estimator, step)
            head = f"{trial.dictionary}, {trial.truth} | {trial.largest_deg:.0f}°, {100 * trial.noise:.0f} % | {name}"
            row = [head, *scores(value, truth, log_sigma, trial.largest_deg), f"{1e3 * seconds:.0f}"]
            click.echo("| " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
