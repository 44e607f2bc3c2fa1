"""What is seen of a live frame."""

import cv2
import numpy as np
import pytest

from drivers.camera import CameraDescription
from drivers.limits import Limits
from instrument.rig.frame_statistics import BLACK, CLIPPED, SHARP, Region, frame_facts, profile


def camera(bayer_pattern: str = "RGGB") -> CameraDescription:
    limits = Limits(1e-5, 1.0, "s")
    return CameraDescription("a", "b", "c", 64, 96, 12, 64.0, 4000.0, bayer_pattern, 2.0, 3.0, limits)


def noise(level: float = 1000.0, sigma: float = 5.0) -> np.ndarray:
    return np.random.default_rng(0).normal(level, sigma, (64, 96)).round().astype(np.uint16)


def test_pixels_at_the_ends_of_the_range_are_marked_and_counted():
    counts = noise()
    counts[2, 3], counts[4, 5], counts[6, 7] = 4000, 4095, 64
    facts = frame_facts(counts, camera())
    assert [tuple(p) for p in np.argwhere(facts.marks == CLIPPED)] == [(2, 3), (4, 5)]
    assert [tuple(p) for p in np.argwhere(facts.marks == BLACK)] == [(6, 7)]
    assert facts.clipped == pytest.approx(2 / counts.size)
    assert facts.black == pytest.approx(1 / counts.size)


def test_each_colour_of_the_mosaic_has_its_own_histogram():
    counts = np.zeros((64, 96), np.uint16)
    counts[::2, ::2], counts[1::2, 1::2] = 1000, 3000
    histogram = frame_facts(counts, camera()).histogram
    assert set(histogram) == {"R", "G", "B"}
    assert [int(histogram[c].argmax()) for c in "RGB"] == [1000 // 16, 0, 3000 // 16]
    assert sum(int(values.sum()) for values in histogram.values()) == counts.size
    assert set(frame_facts(counts, camera("")).histogram) == {"grey"}


def test_what_is_sharper_has_more_focus_and_marks_on_its_edges():
    sharp = noise()
    sharp[:, 48:] += 1500
    blurred = cv2.GaussianBlur(sharp, (0, 0), 4.0)
    facts, other = frame_facts(sharp, camera()), frame_facts(blurred, camera())
    assert facts.focus > 2.0 * other.focus
    assert (facts.marks == SHARP)[:, 44:52].any()
    assert not (facts.marks == SHARP)[:, :40].any()


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_focus_does_not_depend_on_the_exposure(factor: float):
    counts = noise(1000.0, 50.0)
    brighter = ((counts - 64.0) * factor + 64.0).round().astype(np.uint16)
    assert frame_facts(brighter, camera()).focus == pytest.approx(frame_facts(counts, camera()).focus, rel=0.02)


def test_a_mosaic_of_even_colours_is_no_edge():
    counts = np.zeros((64, 96), np.uint16)
    counts[::2, ::2], counts[1::2, 1::2], counts[::2, 1::2], counts[1::2, ::2] = 800, 2400, 1600, 1600
    assert frame_facts(counts, camera()).focus == 0.0


def test_the_numbers_of_a_region_are_those_of_its_pixels_alone():
    counts = noise()
    counts[10:20, 30:50] = 4095
    facts = frame_facts(counts, camera(), Region(10, 30, 20, 50))
    assert facts.clipped == 1.0
    assert sum(int(values.sum()) for values in facts.histogram.values()) == 200
    assert frame_facts(counts, camera()).clipped == pytest.approx(200 / counts.size)


@pytest.mark.parametrize("region", [Region(-5, -7, 900, 900), Region(63, 95, 64, 96), Region(9, 9, 3, 3)])
def test_a_region_is_cut_to_whole_cells_of_the_picture_and_never_empty(region: Region):
    top, left, bottom, right = region.within(64, 96)
    assert 0 <= top < bottom <= 64
    assert 0 <= left < right <= 96
    assert all(n % 2 == 0 for n in (top, left, bottom, right))


def test_a_profile_holds_the_counts_along_the_line_by_colour():
    row, column = np.mgrid[:64, :96]
    counts = (100 * row + column).astype(np.uint16)
    (distance, values) = profile(counts, "", (10.5, 5.5), (10.5, 25.5))["grey"]
    assert distance.tolist() == list(range(21))
    assert values.tolist() == [1000 + c for c in range(5, 26)]
    colours = profile(counts, "RGGB", (10.5, 5.5), (10.5, 25.5))
    assert colours["R"][1].tolist() == [1000 + c for c in range(6, 26, 2)]
    assert colours["G"][0].tolist() == list(range(0, 21, 2))
    assert len(colours["B"][1]) == 0


def test_a_profile_that_leaves_the_picture_ends_at_its_edge():
    distance, values = profile(noise(), "", (0.5, 90.5), (0.5, 120.5))["grey"]
    assert distance.tolist() == [0, 1, 2, 3, 4, 5]
    assert len(values) == 6


def test_marks_are_the_same_where_black_and_clipping_lie_between_counts():
    between = CameraDescription("a", "b", "c", 64, 96, 12, 64.5, 3999.5, "", 2.0, 3.0, Limits(1e-5, 1.0, "s"))
    counts = noise()
    counts[0, 0], counts[0, 2], counts[0, 4], counts[0, 6] = 64, 65, 3999, 4000
    marks = frame_facts(counts, between).marks[0, :8:2].tolist()
    assert [m if m in (BLACK, CLIPPED) else 0 for m in marks] == [BLACK, 0, 0, CLIPPED]


def test_noise_alone_is_in_focus_nowhere_however_bright_the_picture():
    rng = np.random.default_rng(1)
    electrons = np.repeat([0.0, 400.0, 3000.0, 7000.0], 24) * np.ones((64, 1))
    counts = 64.0 + (rng.poisson(electrons) + rng.normal(0.0, 3.0, electrons.shape)) / 2.0
    marks = frame_facts(counts.round().clip(0, 4095).astype(np.uint16), camera()).marks
    steps = np.isin(np.arange(96) // 2, [11, 12, 23, 24, 35, 36])
    assert not (marks[:, ~steps] == SHARP).any()
    assert (marks[:, steps] == SHARP).any(axis=0).sum() >= 8
