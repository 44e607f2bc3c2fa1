from pathlib import Path

import numpy as np
import pytest

from instrument.config.capture_config import ResponseConfig
from instrument.imports.response_curve import CurveError, given_curve, read_curve


@pytest.mark.parametrize("gamma", [1.0, 2.2, "srgb"])
def test_a_given_curve_rises_from_0_to_1(gamma: float | str, tmp_path: Path) -> None:
    curve = given_curve(ResponseConfig(gamma=gamma), 256, tmp_path)
    assert curve is not None
    assert curve.shape == (1, 256)
    assert (curve[0, 0], curve[0, -1]) == (0, 1)
    assert (np.diff(curve) > 0).all()


def test_gamma_1_is_linear_and_srgb_is_close_to_2_2(tmp_path: Path) -> None:
    counts = np.linspace(0, 1, 256)
    np.testing.assert_allclose(given_curve(ResponseConfig(gamma=1.0), 256, tmp_path), counts[None], atol=1e-6)
    np.testing.assert_allclose(given_curve(ResponseConfig(gamma="srgb"), 256, tmp_path), counts[None] ** 2.2, atol=0.01)


def test_srgb_is_that_of_the_standard(tmp_path: Path) -> None:
    curve = given_curve(ResponseConfig(gamma="srgb"), 256, tmp_path)
    assert curve is not None
    # Mid grey of 18 % is 118 in 8 bits, and the foot of the curve is a straight line of slope 1 / 12.92.
    assert curve[0, 118] == pytest.approx(0.18, abs=0.003)
    assert curve[0, 10] == pytest.approx(10 / 255 / 12.92, rel=1e-5)


def test_a_curve_is_straight_between_its_lines_and_scaled_to_1(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("count,red,green,blue\n0,0,0,0\n4,2,4,8\n10,20,40,80\n")
    curve = read_curve(tmp_path / "c.csv", 11)
    assert curve.shape == (3, 11)
    np.testing.assert_allclose(curve[:, [2, 4, 7, 10]], [[0.05, 0.1, 0.55, 1.0]] * 3, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "no table"),
        ("count,value\n0,0\n255,1\n", "c.csv:1 has the columns count, value; needed are count, linear"),
        ("count,linear\n0,0\n100,1\n", "must have ascending counts from 0 to 255"),
        ("count,linear\n0,0\n255,x\n", "no table of numbers"),
        ("count,linear\n0,0\n255\n", "no table"),
        ("count,linear\n0,0\n255,nan\n", "no table of finite numbers"),
        ("count,linear\n0,0\n100,1\n255,0.5\n", "falls somewhere"),
    ],
)
def test_a_file_that_is_no_curve_says_why(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "c.csv").write_text(text)
    with pytest.raises(CurveError, match=expected):
        read_curve(tmp_path / "c.csv", 256)


def test_a_curve_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CurveError, match=r"none.csv cannot be read"):
        read_curve(tmp_path / "none.csv", 256)
