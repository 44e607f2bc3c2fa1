"""The whole chain on the simulated rig: handedness, units, colours, missing values."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

from analysis.camera.calibration import views_of
from analysis.evaluation.metrics import angular_error_deg
from analysis.pixels.samples import BLACK, TOO_FEW_VIEWS
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from analysis.registration.stack_file import read_stack
from analysis.results.result_file import read_result
from tests.checks.conftest import Record
from tests.checks.simulated import PITCH_MM, Simulated
from tests.checks.worlds import NeutralWorld
from tests.synthetic import make_stack

PAPER = 0.85
"""Albedo of the simulated paper, which the chain takes for white."""


@pytest.mark.check(6)
def test_green_alone_gives_the_normals_of_all_colours(record: Record, neutral: NeutralWorld) -> None:
    stack = neutral.stack(neutral.truth.depth)
    green = replace(stack, radiance=stack.radiance[..., 1:2], variance=stack.variance[..., 1:2])
    one, all_three = (
        reconstruct(s, Options(palette="off", light="given", parallax="off")).normals for s in (green, stack)
    )
    assert np.nanmean(angular_error_deg(all_three, neutral.truth.normals)) < 1.0
    apart = angular_error_deg(one, all_three)
    record.at_most("normals of a grey scene, green alone against all colours, mean", np.nanmean(apart), 0.05, "°")
    record.at_most("the same, median", np.nanmedian(apart), 0.05, "°")


@pytest.mark.slow
@pytest.mark.check(12)
def test_an_embossed_letter_stays_convex_and_unmirrored_to_the_file(record: Record, simulated: Simulated) -> None:
    result, truth = read_result(simulated.result_file), simulated.truth
    mirrored = truth.depth[:, ::-1]

    def alike(depth: np.ndarray) -> float:
        return float(np.corrcoef(result.depth.ravel(), depth.ravel())[0, 1])

    record.at_least("correlation of depth with the true relief (inside out: negative)", alike(truth.depth), 0.85)
    record.at_most("the same with its mirror image", alike(mirrored), 0.5)
    # The letter alone: its box of the area, in mm.
    x, y, _ = np.moveaxis(result.grid.points(), -1, 0)
    letter = (x > 4.0) & (x < 23.0) & (y > 1.0) & (y < 26.0)
    slopes = -result.normals[letter, :2] / result.normals[letter, 2:]
    true = -truth.normals[letter, :2] / truth.normals[letter, 2:]
    for name, k in (("slope to the right", 0), ("upward slope", 1)):
        slope = np.sum(slopes[:, k] * true[:, k]) / np.sum(true[:, k] ** 2)
        record.at_most(f"{name} of the letter's normals over the true ones, less 1", abs(slope - 1.0), 0.1)


@pytest.mark.check(14)
def test_lengths_are_millimetres(record: Record, simulated: Simulated) -> None:
    stack, world = simulated.stack, simulated.world
    height, width = stack.radiance.shape[1:3]
    dots_per_inch, size_in_inches = 25.4 / stack.pixel_pitch, np.array(world.bench.area_mm) / 25.4
    off = np.abs(dots_per_inch * size_in_inches - (width, height)).max()
    record.at_most("dots per inch times size less pixels", off, 0.5, "px")
    true = np.stack([world.camera_in_sample(simulated.position(v)) for v in range(stack.n_views)])
    ratio = np.linalg.norm(stack.camera_position, axis=1) / np.linalg.norm(true, axis=1)
    record.at_most("distance of the lens found over true, less 1", 100.0 * np.abs(ratio - 1.0).max(), 0.1, "%")
    with h5py.File(simulated.stack_file) as file:
        lengths = ("camera_position", "light_position", "pixel_pitch", "light_offset", "registration_sigma")
        units = {file[f"/entry/geometry/{name}"].attrs["units"] for name in lengths}
    with h5py.File(simulated.result_file) as file:
        units |= {file[f"/entry/result/{name}"].attrs["units"] for name in ("depth", "depth_sigma", "pixel_pitch")}
        assert file["/entry/result/pixel_pitch"][()] == PITCH_MM
    record.holds("every length of stack and result says that it is in mm", units == {"mm"})


@pytest.mark.check(15)
def test_the_stack_is_in_units_of_the_white_paper(record: Record, simulated: Simulated) -> None:
    """Where paper is 1 / pi, the sample's radiance is its true one over the paper's albedo."""
    stack = simulated.stack
    ratios = [
        np.nanmedian(stack.radiance[v] / stack.light_power[v] / simulated.radiance(v) * PAPER)
        for v in range(stack.n_views)
    ]
    record.at_most(
        "radiance of the relief over the true one in units of paper, less 1",
        100.0 * abs(np.median(ratios) - 1.0),
        1.0,
        "%",
    )


@pytest.mark.check(20)
def test_no_value_is_missing_without_a_reason(record: Record, simulated: Simulated) -> None:
    frames, session, calibration = simulated.frames, simulated.session, simulated.calibration
    at_merge = sum(int(np.isnan(frames.merge(int(i)).mean).sum()) for i in calibration.i_pose)
    record.at_most(
        f"values missing after the merge of {len(calibration.i_pose)} poses, none of them unexplained", at_merge, 0
    )
    assert frames.findings.n_nan == 0
    stack, margin = read_stack(simulated.stack_file), 12
    width, height = session.camera.width, session.camera.height
    unexplained = 0
    for v, view in enumerate(views_of(calibration.camera)):
        u, w = np.moveaxis(view.project(stack.grid.points()), -1, 0)
        inside = (u > margin) & (u < width - margin) & (w > margin) & (w < height - margin)
        unexplained += int(np.isnan(stack.radiance[v][inside]).sum() + np.isnan(stack.variance[v][inside]).sum())
    record.at_most("values missing in the stack where the picture shows the sample", unexplained, 0)
    record.at_most(
        "normals or depths missing in the result without a flag", unflagged(read_result(simulated.result_file)), 0
    )


@pytest.mark.check(20)
def test_what_is_missing_on_purpose_is_missing_with_a_flag(record: Record) -> None:
    whole = make_stack(n_views=30, size=16)
    radiance = whole.radiance.copy()
    radiance[:, 3:6, 4:8] = np.nan
    radiance[5:, 9, 9] = np.nan
    radiance[:27, 12, 2] = np.nan
    radiance[:, 14, 14] = 0.0
    result = reconstruct(replace(whole, radiance=radiance, variance=None), Options(palette="off", accuracy="draft"))
    missing = np.isnan(result.normals[..., 0])
    assert missing[3:6, 4:8].all()
    assert missing[12, 2]
    record.at_most("pixels without a normal, of 13 that cannot have one, without a flag", unflagged(result), 0)
    assert np.isfinite(result.normals).all(axis=-1).sum() >= 256 - 14


def unflagged(result: object) -> int:
    """Count the pixels without a normal or without a depth that no flag explains."""
    missing = np.isnan(result.normals).any(axis=-1) | np.isnan(result.depth)
    return int(np.sum(missing.ravel() & (result.fits.flags & (TOO_FEW_VIEWS | BLACK) == 0)))
