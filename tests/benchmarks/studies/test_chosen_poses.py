import numpy as np
import pytest

from benchmarks.studies.chosen_poses import (
    EXAMPLES,
    SIZE,
    THETA_H,
    Views,
    all_views,
    figures_of_stack,
    simulated_sample,
)
from instrument.config.loading import load_rig

RIG = load_rig(EXAMPLES / "simulated.toml")


def test_a_simulated_sample_shows_its_true_curves_and_is_lit_where_it_is_seen() -> None:
    sample = simulated_sample(RIG, "sphere_cap", 3)
    stack = sample.stack(Views("two", ({"tilt": 0.0, "turn": 0.0}, {"tilt": 40.0, "turn": 30.0}), ()))
    assert sample.curve.shape == (SIZE * SIZE, len(THETA_H), 3)
    assert (sample.curve > 0.0).all()
    assert (np.diff(sample.curve[:, :, 0], axis=1) < 0.0).all()  # lacquer: a lobe, and nothing at grazing angles
    assert np.isfinite(stack.radiance[0]).all()
    assert stack.truth is not None
    assert stack.truth.normals.shape == (SIZE, SIZE, 3)


@pytest.mark.slow
def test_25_chosen_poses_give_better_normals_than_25_on_rings() -> None:
    sample, views = simulated_sample(RIG, "relief", 5), {some.name: some for some in all_views(RIG)}
    rings, chosen = (figures_of_stack(sample, views[name]) for name in ("25 on rings", "25 chosen"))
    assert chosen.mean < 0.9 * rings.mean
    assert chosen.p95 < 0.9 * rings.p95
