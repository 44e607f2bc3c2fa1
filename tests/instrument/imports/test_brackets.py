import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from instrument.imports.brackets import exposure_indices, nominal_times, split_by_exposure
from instrument.imports.sensor import guessed_depth, shift_of


@pytest.mark.parametrize(
    ("times", "sizes"),
    [
        ([0.01, 0.1, 1, 0.01, 0.1, 1], [3, 3]),
        ([1, 0.1, 0.01, 1, 0.1, 0.01], [3, 3]),
        # A camera's own bracketing: middle, under, over.
        ([1 / 60, 1 / 250, 1 / 15, 1 / 60, 1 / 250, 1 / 15], [3, 3]),
        # The second bracket has other times, and the third one frame more.
        ([0.01, 0.1, 0.005, 0.05, 0.01, 0.1, 1], [2, 2, 3]),
        # The same setting, stated with other digits.
        ([0.0167, 0.1, 0.01666, 0.1], [2, 2]),
        ([0.1, 0.1, 0.1], [1, 1, 1]),
        ([0.01, 0.1, 1], [3]),
        ([0.5], [1]),
    ],
)
def test_a_pose_begins_where_its_bracket_begins_anew(times: list[float], sizes: list[int]) -> None:
    assert split_by_exposure(times) == sizes


@given(
    bracket=st.lists(st.integers(-8, 4), min_size=2, max_size=6, unique=True),
    n_poses=st.integers(2, 7),
)
def test_equal_brackets_are_found_in_any_order_of_their_times(bracket: list[int], n_poses: int) -> None:
    times = [2.0**stop for stop in bracket]
    assert split_by_exposure(times * n_poses) == [len(bracket)] * n_poses


def test_the_times_of_a_session_are_all_that_any_pose_has() -> None:
    assert nominal_times([[0.1, 0.01], [0.1, 1.0]]) == (0.01, 0.1, 1.0)


def test_times_of_one_setting_are_one_exposure() -> None:
    times = nominal_times([[1 / 60, 0.1], [0.01665, 0.1], [0.0169, 0.1]])
    assert times == (0.0167, 0.1)
    assert exposure_indices([0.1, 0.01665], times) == [1, 0]


def test_a_nominal_time_has_no_digits_that_arithmetic_added() -> None:
    assert nominal_times([[0.049999999999999996, 1 / 3]]) == (0.05, 0.333333)


def test_close_times_in_one_pose_are_meant() -> None:
    assert nominal_times([[0.1, 0.101], [0.1]]) == (0.1, 0.101)


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
@pytest.mark.parametrize("stated", [True, False])
def test_left_and_right_aligned_counts_become_the_same(bits: int, stated: bool) -> None:
    counts = np.random.default_rng(bits).integers(0, 1 << bits, 1000).astype(np.uint16)
    left = counts << np.uint16(16 - bits)
    depth = bits if stated else None
    for aligned in (counts, left):
        shift = shift_of(int(np.bitwise_or.reduce(aligned)), depth)
        np.testing.assert_array_equal(aligned >> np.uint16(shift), counts)


def test_a_low_bit_that_is_never_set_is_no_alignment() -> None:
    assert shift_of(0b1111_1111_1110, None) == 0
    assert shift_of(0b1111_1111_1111_1000, None) == 2
    assert shift_of(0, None) == 0


def test_a_stated_depth_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="bit_depth is 12, but the pictures hold counts up to 16 bits"):
        shift_of(0xFFFF, 12)


def test_the_depth_is_guessed_from_the_largest_count() -> None:
    assert [guessed_depth(bits, 0) for bits in (255, 1000, 4095, 4096, 65535)] == [10, 10, 12, 14, 16]
    assert guessed_depth(0xFFF0, 4) == 12


@pytest.mark.parametrize("order", [(0, -2, 2), (0, 2, -2), (-2, 0, 2), (2, 0, -2), (0, -1, 1, -2, 2)])
def test_brackets_in_the_order_of_any_maker_are_told_apart_by_their_steps(order: tuple[int, ...]) -> None:
    """The base exposure differs from pose to pose, as with an automatic exposure."""
    bases = [1 / 60, 1 / 80, 1 / 60, 1 / 100, 1 / 320]
    times = [base * 2.0**stop for base in bases for stop in order]
    assert split_by_exposure(times) == [len(order)] * len(bases)


def test_a_series_that_only_rises_is_one_bracket() -> None:
    assert split_by_exposure([0.01 * 2.0**i for i in range(9)]) == [9]
