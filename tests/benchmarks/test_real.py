from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.scenes import POSES, relief_of
from benchmarks.real.cases import captures
from benchmarks.real.run import Row, shortfalls
from benchmarks.real.text import rows_table
from instrument.files.validation import InvalidInputError

GOOD = Row(
    case="card",
    method="default",
    materials="6 materials by colour",
    left_out=0.26,
    left_out_worst=0.31,
    left_out_gain=0.25,
    light_mm=(2.0, 9.5),
    light_sigma_mm=(3.1, 3.4),
    light_off_mm=2.0,
    lean_deg=0.1,
    error_mean_deg=None,
    error_median_deg=None,
    coverage68=None,
    coverage95=None,
    told=(),
    seconds=100.0,
)


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"left_out": 0.58}, "views left out to 58%"),
        ({"left_out_worst": 0.95}, "worst 95%"),
        ({"light_off_mm": 60.0}, "60.0 mm off"),
        ({"case": "ball in a dome", "error_mean_deg": 2.0}, "told: nothing"),
        ({"case": "ball in a dome", "error_mean_deg": 5.0, "told": ("OUTSIDE THE DOMAIN",)}, "5.0 deg"),
    ],
)
def test_what_falls_short_is_named(changed: dict, word: str):
    (text,) = shortfalls([replace(GOOD, **changed)])
    assert word in text


def test_the_default_must_not_be_worse_than_no_palette():
    (text,) = shortfalls([GOOD, replace(GOOD, method="palette off", left_out=0.2)])
    assert "worse than without a palette" in text
    assert shortfalls([GOOD, replace(GOOD, method="palette off", left_out=0.5)]) == []


def test_a_row_that_lacks_figures_is_printed():
    lines = rows_table([GOOD, replace(GOOD, light_mm=None, light_sigma_mm=None, light_off_mm=None)]).splitlines()
    assert len(lines) == 3
    assert "26 %" in lines[1]


def test_without_the_data_the_case_is_refused_with_a_word(tmp_path: Path):
    with pytest.raises(InvalidInputError) as error:
        list(captures(0, tmp_path / "nowhere"))
    assert "HALFANGLE_SHARED_DATA" in str(error.value.problems)


def test_a_relief_of_a_lambertian_function_is_the_cosine_over_the_squared_distance():
    rng = np.random.default_rng(0)

    def white(omega_i: np.ndarray, omega_o: np.ndarray) -> np.ndarray:
        return np.full((len(omega_i), 3), 1.0 / np.pi)

    stack = relief_of([white], 16, POSES["cap"](5, rng), 1e-9, rng)
    assert stack.truth is not None
    points = stack.grid.points(stack.truth.depth)
    to_light = stack.light_position[2] - points
    distance = np.linalg.norm(to_light, axis=-1)
    shading = np.sum(stack.truth.normals * to_light, axis=-1) / distance
    # Depth has its mean taken off, which moves points by a few hundredths of a millimetre at most.
    np.testing.assert_allclose(stack.radiance[2, ..., 0], shading / (np.pi * distance**2), rtol=0.03)
