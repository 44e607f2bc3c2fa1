"""From counts to radiance: black, clipping, curves, times, powers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.pixels.samples import CLIPPED
from analysis.radiometry.exposure_ratios import WARN_DEVIATION
from analysis.radiometry.frames import MergedFrames
from analysis.radiometry.hdr import Sensor, merge_bracket
from analysis.radiometry.response_fit import fit_response
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from instrument.files.validation import InvalidInputError
from instrument.imports.prepare import prepare_import
from instrument.imports.writing import write_import
from instrument.session import layout
from instrument.session.session import Session
from tests.analysis.radiometry import test_exposure_ratios as ratios
from tests.analysis.radiometry import test_response_fit as curves
from tests.analysis.radiometry.test_frames import BLACK, CLIPS_AT, RADIANCE, TIMES, FakeSession, counts, darks, poses
from tests.analysis.registration.test_rectification import on_grid
from tests.checks.conftest import Record
from tests.checks.simulated import Simulated
from tests.instrument.imports.folders import write_capture, write_dng, write_png, write_tiff
from tests.synthetic import make_stack

WARN_BLACK = 0.5
"""Counts by which the darks may differ from the black that is used."""


def imported(folder: Path, text: str) -> Session:
    write_import(prepare_import(folder, write_capture(folder, 'name = "check"\n' + text)), folder / "s.h5")
    return Session(folder / "s.h5")


def of_cell(frames: np.ndarray) -> np.ndarray:
    """Return the medians of the four places of the cell, shape (2, 2)."""
    return np.array([[np.median(frames[..., i::2, j::2]) for j in (0, 1)] for i in (0, 1)])


@pytest.mark.check(1)
def test_the_black_that_is_subtracted_is_that_of_the_darks(record: Record, simulated: Simulated) -> None:
    found = simulated.frames.findings
    dark, true = simulated.session.dark, simulated.world.sensor.black_level
    record.at_most(
        "black used less the darks' median", np.abs(found.black_used - of_cell(dark)).max(), WARN_BLACK, "DN"
    )
    record.at_most("black used less the sensor's", np.abs(found.black_used - true).max(), WARN_BLACK, "DN")


@pytest.mark.check(1)
def test_a_stated_black_that_is_four_counts_too_high_is_told(record: Record) -> None:
    session = FakeSession(poses(), dark=darks(), black_level_cell=BLACK + 4.0)
    found = MergedFrames(session).findings
    off = np.abs(found.black_nominal - found.black_dark).min()
    record.at_least("4 DN too high, as the darks tell it", off, WARN_BLACK, "DN")
    session.dark = None
    told = -MergedFrames(session).findings.ratios.black_error
    record.at_least("the same without darks, as the exposures tell it", told.min(), WARN_BLACK, "DN")


@pytest.mark.check(2)
def test_the_clipping_level_is_found_from_the_pile_up(record: Record) -> None:
    found = MergedFrames(FakeSession(poses(), dark=darks())).findings.saturation
    assert found.nominal - CLIPS_AT == 195
    off = np.abs(found.level - CLIPS_AT).max()
    record.at_most("pile-up found less the true one, 195 DN below the stated level", off, 1.0, "DN")


@pytest.mark.check(2)
def test_counts_shifted_in_their_container_give_the_same_radiance(record: Record, tmp_path: Path) -> None:
    merged = []
    for name, shift in (("right", 0), ("left", 4)):
        (tmp_path / name).mkdir()
        for e, frame in enumerate(counts()):
            write_tiff(tmp_path / name / f"{e}.tif", frame << np.uint16(shift), float(TIMES[e]))
        text = '[camera]\nbayer_pattern = "RGGB"\nblack_level = 65\n[grouping]\nby = "exposure"\n'
        with imported(tmp_path / name, text) as session:
            merged.append(MergedFrames(session).merge(0))
    seen = ~merged[0].saturated
    assert np.median(merged[0].mean[seen] / RADIANCE[seen]) == pytest.approx(1.0, abs=0.01)
    worst = np.abs(merged[1].mean / merged[0].mean - 1.0).max()
    record.at_most("radiance of left- over right-aligned counts, worst pixel", 100.0 * worst, 0.0, "%")
    np.testing.assert_array_equal(merged[0].saturated, merged[1].saturated)


@pytest.mark.check(3)
def test_what_clips_in_every_exposure_is_flagged_on_the_grid(record: Record) -> None:
    bracket = np.stack([np.round(64.0 + 2e4 * t) * np.ones((240, 320)) for t in TIMES]).astype(np.uint16)
    bracket[:, 100:130, 150:170] = 4095
    merged = merge_bracket(bracket, TIMES, np.full((2, 2), 64.0), Sensor(4095.0, 2.5, 3.0))
    clipped = (bracket == 4095).all(axis=0)
    record.at_most("clipped pixels that are not flagged, after the merge", np.sum(clipped & ~merged.saturated), 0)
    seen = on_grid(merged.mean, "RGGB", variance=merged.variance, saturated=merged.saturated)
    moved = np.abs(seen.radiance / 2e4 - 1.0) > 0.02
    assert (seen.saturated > 0).sum() > 50
    record.at_most("pixels changed by them and not flagged, on the grid", np.sum(moved & (seen.saturated == 0)), 0)


@pytest.mark.check(3)
def test_a_clipped_value_is_no_more_than_a_bound_to_the_solver(record: Record) -> None:
    whole = make_stack(n_views=40, size=16)
    level = np.percentile(whole.radiance, 90.0)
    clipped = whole.radiance >= level
    cut = replace(whole, radiance=np.minimum(whole.radiance, level), saturated=clipped.astype(np.uint8))
    result = reconstruct(cut, Options(light="given"))
    some = clipped.any(axis=(0, 3))
    unflagged = np.sum(result.fits.flags.reshape(some.shape)[some] & CLIPPED == 0)
    record.at_most("pixels with clipped views that are not flagged, in the result", unflagged, 0)
    error, sigma = (angular_error_deg(result.normals, whole.truth.normals)[some], result.fits.normal_sigma)
    ratio = np.deg2rad(error) / np.sqrt(2.0) / sigma.reshape(some.shape)[some]
    record.at_most("normal error there, in stated sigmas, RMS", np.sqrt(np.mean(ratio**2)), 1.5)
    points = whole.grid.points(result.depth).reshape(-1, 3)
    places = zip(whole.camera_position, whole.light_position, strict=True)
    predicted = np.stack([result.fits.radiance(points, *place) for place in places]).reshape(clipped.shape)
    # Taken for true, these would be predicted a fifth too dark at least.
    far = whole.radiance > 1.25 * level
    assert far.sum() > 100
    ratio = np.median(predicted[far] / whole.radiance[far])
    record.at_least("radiance of highlights clipped a fifth below it, predicted over true, median", ratio, 0.9)


@pytest.mark.check(4)
def test_eight_bit_pictures_need_a_curve(record: Record, tmp_path: Path) -> None:
    pictures = curves.bracket(curves.srgb_encoded)
    times = curves.TIMES
    for i, picture in enumerate(pictures):
        write_png(tmp_path / f"{i}.png", picture)
    grouping = f"[grouping]\nexposure_times_s = {times.tolist()}\nframes_per_pose = {len(times)}\n"
    with pytest.raises(InvalidInputError, match="not proportional to light"):
        imported(tmp_path, grouping)
    record.holds("8-bit pictures without a curve are refused", not (tmp_path / "s.h5").exists())
    with imported(tmp_path, f'linear = false\nresponse = {{ gamma = "srgb" }}\n{grouping}') as session:
        slope = MergedFrames(session).findings.ratios.slope
    record.at_most("slope of log counts over log time less 1, with a curve given", abs(slope - 1.0), 0.01)
    fitted = fit_response(pictures, times)
    record.at_most("the same with a curve from the bracket", abs(fitted.slope - 1.0), 0.01)


@pytest.mark.check(5)
def test_exposure_times_that_are_two_percent_off_are_found(record: Record) -> None:
    true = ratios.NOMINAL * np.array([0.98, 1.0, 1.02, 1.0])
    found = ratios.estimate(ratios.samples(true))
    error = np.abs(found.ratio / (true[1:] / true[:-1]) - 1.0).max()
    record.at_most("ratio of exposure times, found over true, less 1", 100.0 * error, 0.3, "%")
    least = np.abs(found.deviation).min()
    record.at_least("their deviation from the reported ones", 100.0 * least, 100.0 * WARN_DEVIATION, "%")
    right = np.abs(ratios.estimate(ratios.samples(ratios.NOMINAL)).deviation).max()
    record.at_most("deviation of times that are right", 100.0 * right, 100.0 * WARN_DEVIATION, "%")


@pytest.mark.check(5)
def test_the_power_of_each_view_comes_from_the_white(record: Record, simulated: Simulated) -> None:
    with h5py.File(simulated.session.path, locking=False) as file:
        drift = file[layout.MONITOR.path][...].mean(axis=1)[simulated.calibration.i_pose]
    true = drift * [simulated.world.light_power(simulated.position(v)) for v in range(simulated.stack.n_views)]
    assert np.std(true / true.mean()) > 0.01
    ratio = simulated.stack.light_power / true
    off = ratio / ratio.mean() - 1.0
    record.at_most("power of a view found over true, less 1, at 2 % of jitter, RMS", 100.0 * off.std(), 0.5, "%")


@pytest.mark.check(7)
def test_twice_the_exposure_time_is_twice_the_counts_of_a_raw_file(record: Record, tmp_path: Path) -> None:
    light = np.random.default_rng(0).uniform(200.0, 1800.0, (48, 64))
    black = np.tile([[64.0, 65.0], [66.0, 67.0]], (24, 32))
    for i, time in enumerate((0.1, 0.2)):
        write_dng(tmp_path / f"{i}.dng", np.round(black + light * time / 0.1).astype(np.uint16), time)
    with imported(tmp_path, '[grouping]\nby = "exposure"\n') as session:
        first, second = session.frames(0) - black
        assert session.exposure_times[1] == 2.0 * session.exposure_times[0]
    worst = np.abs(of_cell(second) / of_cell(first) / 2.0 - 1.0).max()
    record.at_most("counts at twice the time over twice the counts, less 1, worst colour", 100.0 * worst, 0.5, "%")


@pytest.mark.check(7)
def test_the_counts_of_a_bracket_grow_with_its_times(record: Record, simulated: Simulated) -> None:
    off = np.abs(simulated.frames.findings.ratios.deviation).max()
    record.at_most("counts at five times the time over five times the counts, less 1", 100.0 * off, 0.5, "%")
