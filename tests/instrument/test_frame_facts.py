"""What is seen of a live frame."""

import cv2
import numpy as np
import pytest

from drivers.camera import CameraDescription
from drivers.limits import Limits
from gui.live_facts import BLACK, CLIPPED, SHARP, live_facts


def camera(bayer_pattern: str = "RGGB") -> CameraDescription:
    limits = Limits(1e-5, 1.0, "s")
    return CameraDescription("a", "b", "c", 64, 96, 12, 64.0, 4000.0, bayer_pattern, 2.0, 3.0, limits)


def noise(level: float = 1000.0, sigma: float = 5.0) -> np.ndarray:
    return np.random.default_rng(0).normal(level, sigma, (64, 96)).round().astype(np.uint16)


def test_pixels_at_the_ends_of_the_range_are_marked_and_counted():
    counts = noise()
    counts[2, 3], counts[4, 5], counts[6, 7] = 4000, 4095, 64
    facts = live_facts(counts, camera())
    assert [tuple(p) for p in np.argwhere(facts.marks == CLIPPED)] == [(2, 3), (4, 5)]
    assert [tuple(p) for p in np.argwhere(facts.marks == BLACK)] == [(6, 7)]
    assert facts.clipped == pytest.approx(2 / counts.size)
    assert facts.black == pytest.approx(1 / counts.size)


def test_the_picture_goes_from_black_to_clipping():
    counts = np.array([[0, 64], [2024, 4095]], np.uint16).repeat(32, 0).repeat(48, 1)
    shown = live_facts(counts, camera()).shown[::32, ::48]
    assert shown.tolist() == [[0, 0], [127, 255]]


def test_each_colour_of_the_mosaic_has_its_own_histogram():
    counts = np.zeros((64, 96), np.uint16)
    counts[::2, ::2], counts[1::2, 1::2] = 1000, 3000
    histogram = live_facts(counts, camera()).histogram
    assert set(histogram) == {"R", "G", "B"}
    assert [int(histogram[c].argmax()) for c in "RGB"] == [1000 // 16, 0, 3000 // 16]
    assert sum(int(values.sum()) for values in histogram.values()) == counts.size
    assert set(live_facts(counts, camera("")).histogram) == {"grey"}


def test_what_is_sharper_has_more_focus_and_marks_on_its_edges():
    sharp = noise()
    sharp[:, 48:] += 1500
    blurred = cv2.GaussianBlur(sharp, (0, 0), 4.0)
    facts, other = live_facts(sharp, camera()), live_facts(blurred, camera())
    assert facts.focus > 2.0 * other.focus
    assert (facts.marks == SHARP)[:, 44:52].any()
    assert not (facts.marks == SHARP)[:, :40].any()


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_focus_does_not_depend_on_the_exposure(factor: float):
    counts = noise(1000.0, 50.0)
    brighter = ((counts - 64.0) * factor + 64.0).round().astype(np.uint16)
    assert live_facts(brighter, camera()).focus == pytest.approx(live_facts(counts, camera()).focus, rel=0.02)


def test_a_mosaic_of_even_colours_is_no_edge():
    counts = np.zeros((64, 96), np.uint16)
    counts[::2, ::2], counts[1::2, 1::2], counts[::2, 1::2], counts[1::2, ::2] = 800, 2400, 1600, 1600
    assert live_facts(counts, camera()).focus == 0.0
