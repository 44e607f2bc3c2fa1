"""Samples of one pixel against the curve that was fitted to them."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.evaluation.scoring import score
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.registration.stack import Stack
from analysis.registration.stack_file import write_stack
from analysis.results.points import CLIPPED, UNSEEN, USED, WRONG, PointSamples, point_curve, point_samples, source_stack
from analysis.results.result import Result, result_of
from analysis.results.result_file import read_result, write_result
from analysis.results.summary import SourceFile
from instrument.files.validation import InvalidInputError
from tests.synthetic import make_stack

N_VIEWS, SIZE = 30, 12


@pytest.fixture(scope="module")
def stack() -> Stack:
    made = make_stack(n_views=N_VIEWS, size=SIZE, registered_to="plane")
    radiance = made.radiance.copy()
    radiance[4] *= 3.0
    radiance[5, 3, 5] = np.nan
    saturated = np.zeros(radiance.shape, np.uint8)
    saturated[6, 3, 5, 1] = 1
    return replace(made, radiance=radiance, saturated=saturated)


@pytest.fixture(scope="module")
def reconstruction(stack: Stack) -> Reconstruction:
    return reconstruct(stack, Options(palette="off", parallax="on"))


@pytest.fixture(scope="module")
def result(reconstruction: Reconstruction) -> Result:
    return result_of(reconstruction, [], score(reconstruction, 0), None)


@pytest.fixture(scope="module")
def samples(result: Result, stack: Stack) -> PointSamples:
    return point_samples(result, stack, 3, 5)


def test_the_samples_that_are_used_lie_on_the_curve_within_their_sigma(result: Result, samples: PointSamples):
    curve = point_curve(result, 3, 5)
    fitted = np.stack([np.interp(samples.theta_h, curve.theta_h, f) for f in curve.f.T], axis=1)
    off = ((samples.f - fitted) / samples.sigma)[samples.use == USED]
    assert len(off) > 2 * N_VIEWS
    assert np.abs(off).max() < 6.0
    assert 0.3 < np.sqrt(np.mean(off**2)) < 2.0


def test_the_half_angles_are_those_that_the_result_says_it_was_seen_at(result: Result, samples: PointSamples):
    seen = (samples.use != UNSEEN).any(axis=1)
    near, far = point_curve(result, 3, 5).seen
    np.testing.assert_allclose([samples.theta_h[seen].min(), samples.theta_h[seen].max()], [near, far], atol=1e-2)


def test_a_sample_says_what_became_of_it(samples: PointSamples):
    assert (samples.use[4] == WRONG).all()
    # Bicubic resampling reaches two pixels round a missing one.
    assert (samples.use[5] == UNSEEN).all()
    assert np.isnan(samples.f[5]).all()
    assert samples.use[6, 1] == CLIPPED
    assert (samples.use[np.r_[0:4, 7:N_VIEWS]] == USED).all()


def test_a_grid_without_that_pixel_is_said(result: Result, stack: Stack):
    with pytest.raises(IndexError, match=r"row 12, column 5; rows are 0 to 11"):
        point_curve(result, 12, 5)
    with pytest.raises(IndexError, match="columns 0 to 11"):
        point_samples(result, stack, 0, -1)


def test_an_unsolved_pixel_has_no_curve_and_no_samples(result: Result, stack: Stack):
    normals = result.fits.normals.copy()
    normals[3 * SIZE + 5] = np.nan
    unsolved = replace(result, fits=replace(result.fits, normals=normals))
    curve = point_curve(unsolved, 3, 5)
    assert np.isnan(curve.f).all()
    assert "unsolved" in curve.flags
    assert (point_samples(unsolved, stack, 3, 5).use == UNSEEN).all()


def test_a_result_keeps_the_views_as_they_were_fitted(result: Result, tmp_path: Path):
    write_result(tmp_path / "r.h5", result)
    views, back = result.views, read_result(tmp_path / "r.h5").views
    assert back.noise == views.noise
    assert back.level == pytest.approx(views.level)
    for name in ("camera_position", "light_position", "light_power"):
        np.testing.assert_array_equal(getattr(back, name), getattr(views, name))


def with_source(result: Result, name: str, digest: str) -> Result:
    return replace(result, summary=replace(result.summary, source=SourceFile(name, digest)))


def test_the_stack_is_found_beside_the_result_and_known_by_its_digest(result: Result, stack: Stack, tmp_path: Path):
    write_stack(tmp_path / "a.stack.h5", stack)
    digest = hashlib.sha256((tmp_path / "a.stack.h5").read_bytes()).hexdigest()
    found = source_stack(tmp_path / "a.result.h5", with_source(result, "a.stack.h5", digest))
    np.testing.assert_array_equal(found.radiance, stack.radiance)
    (tmp_path / "a.stack.h5").rename(tmp_path / "b.stack.h5")
    with pytest.raises(InvalidInputError, match=r"put a\.stack\.h5, which a\.result\.h5 came from, beside it"):
        source_stack(tmp_path / "a.result.h5", with_source(result, "a.stack.h5", digest))
    elsewhere = with_source(result, "a.stack.h5", digest)
    assert source_stack(tmp_path / "a.result.h5", elsewhere, tmp_path / "b.stack.h5").n_views == N_VIEWS
    with pytest.raises(InvalidInputError, match="has changed since"):
        source_stack(tmp_path / "a.result.h5", with_source(result, "b.stack.h5", "0" * 64))


def test_a_result_that_does_not_name_its_stack_is_refused(result: Result, tmp_path: Path):
    for nameless in (result, replace(with_source(result, "a", "b"), views=None)):
        with pytest.raises(InvalidInputError, match="does not say which stack it came from"):
            source_stack(tmp_path / "a.result.h5", nameless)
