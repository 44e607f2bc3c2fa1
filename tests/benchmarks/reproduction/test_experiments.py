"""The experiments on traits, cameras and real photographs: their parts, and each of them once in small."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.scenes import relief
from benchmarks.reproduction.experiment import Experiment, Request, SkippedError, Verdict
from benchmarks.reproduction.experiments import cameras, real, traits
from benchmarks.reproduction.reproduce import NAMES
from benchmarks.reproduction.run_experiment import load


@pytest.fixture(scope="module")
def scene():
    return relief(24, 20, 0.0, 4, floor=0.0)


def test_every_experiment_of_the_table_is_there():
    for name in NAMES:
        experiment = load(name)
        assert isinstance(experiment, Experiment)
        assert experiment.name == name


def test_a_bracket_merges_to_the_radiance_within_the_variance_that_it_states(scene):
    stack = cameras.through(scene, cameras.LABORATORY, np.random.default_rng(0))
    good = stack.saturated == 0
    pull = (stack.radiance - scene.stack.radiance)[good] / np.sqrt(stack.variance[good])
    assert abs(np.mean(pull)) < 0.2
    assert 0.8 < np.std(pull) < 1.2


def test_one_exposure_clips_what_a_bracket_keeps(scene):
    bracket, single = (
        cameras.through(scene, sensor, np.random.default_rng(0)) for sensor in (cameras.LABORATORY, cameras.PHONE)
    )
    assert single.saturated.mean() > bracket.saturated.mean()
    assert np.median(single.variance) > np.median(bracket.variance)


def test_a_scene_of_traits_has_a_material_of_each_but_one():
    rows = traits.one_of_each("sgd", np.random.default_rng(3))
    names = traits.published("sgd")["name"][rows]
    assert len({traits.trait_index(str(name)) for name in names}) == traits.N_MATERIALS
    assert "other" not in [traits.TRAITS[traits.trait_index(str(name))] for name in names]


def test_a_confidence_that_is_the_share_of_right_ones_is_calibrated():
    rng = np.random.default_rng(0)
    confidence = rng.uniform(0.2, 1.0, 20_000)
    assert traits.calibration_error(confidence, rng.random(20_000) < confidence) < 0.02
    assert traits.calibration_error(np.full(100, 0.9), np.zeros(100, bool)) == pytest.approx(0.9)


def test_the_three_maps_take_two_traits_each():
    assert traits.group_of(np.arange(7)).tolist() == [0, 0, 1, 1, 2, 2, 3]


def test_without_the_photographs_the_real_experiment_is_skipped(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(real, "SHARED", tmp_path)
    with pytest.raises(SkippedError, match="HALFANGLE_SHARED_DATA"):
        real.photographs(8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["traits", "cameras", "real"])
def test_each_finds_something_and_draws_it(name: str, tmp_path: Path):
    try:
        found = load(name).run(Request(tmp_path, quick=True, seed=1))
    except SkippedError as why:
        pytest.skip(str(why))
    assert isinstance(found.verdict, Verdict)
    assert found.ours
    assert found.why
    assert all(figure.stat().st_size < 200_000 for figure in found.figures)
