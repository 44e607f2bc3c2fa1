"""A small result without a palette: every pixel has atoms of its own, drawn from a dictionary."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.reflectance.dictionary import Dictionary
from analysis.results.result import Result
from tests.analysis.export.scene import small_result


def result_of(dictionary: Dictionary, n_channels: int = 3, seed: int = 0) -> Result:
    """Return the small result with up to three atoms in each channel of a pixel."""
    made, rng = small_result(), np.random.default_rng(seed)
    n = len(made.fits.normals)
    atom = np.full((n, n_channels, 6), -1, np.int16)
    atom[..., :3] = rng.integers(0, len(dictionary.atoms), (n, n_channels, 3))
    atom[..., 1:3] = np.where(rng.random((n, n_channels, 2)) < 0.5, atom[..., 1:3], -1)
    # Atoms weigh alike, so that a lobe of a table's is not lost beside one that is a thousand times as bright.
    level = np.sqrt(np.mean(dictionary.slice_table().value ** 2, axis=0)) * dictionary.slice_table().scale
    coefficient = rng.uniform(0.05, 1.0, atom.shape) / np.maximum(level, 1e-6)[np.maximum(atom, 0)]
    fits = replace(
        made.fits, atom=atom, coefficient=np.where(atom >= 0, coefficient, 0.0), dictionary=dictionary
    )  # fmt: skip
    return replace(made, fits=fits)
