"""`halfangle import --registered`: pictures from elsewhere, good ones and bad ones."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.light.offset import pooled_light_offset
from analysis.registration.stack_file import read_stack
from cli.main import main

SHARED = Path(os.environ.get("HALFANGLE_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data"))


def run(*arguments: str | Path) -> int:
    """Run `halfangle import` and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main(["import", "--registered", *(str(argument) for argument in arguments)])
    return int(ended.value.code or 0)


@pytest.fixture
def card(tmp_path: Path) -> Path:
    """A folder of four 8-bit pictures with display gamma, and their table."""
    folder = tmp_path / "card"
    folder.mkdir()
    rows = ["file,camera_x_cm,camera_y_cm,camera_z_cm"]
    for i in range(4):
        picture = np.full((12, 16, 3), 64 * (i + 1) - 1, np.uint8)
        picture[:, :, 0] = 10  # blue in OpenCV's order
        cv2.imwrite(str(folder / f"{i}.png"), picture)
        rows.append(f"{i}.png,{i},{-i},17")
    (folder / "positions.csv").write_text("\n".join(rows))
    return folder


def test_pictures_become_linear_radiance_with_clipped_pixels_as_bounds(card: Path, tmp_path: Path) -> None:
    arguments = ("--positions", "positions.csv", "--width-mm", "32", "--gamma", "2.2", "-o", tmp_path / "c.stack.h5")
    assert run(card, *arguments) == 0
    stack = read_stack(tmp_path / "c.stack.h5")
    assert stack.radiance.shape == (4, 12, 16, 3)
    assert stack.pixel_pitch == pytest.approx(2.0)
    np.testing.assert_allclose(stack.camera_position[2], [20.0, -20.0, 170.0])
    np.testing.assert_allclose(stack.radiance[1, 0, 0, 0], (127 / 255) ** 2.2, rtol=1e-5)
    np.testing.assert_allclose(stack.radiance[1, 0, 0, 2], (10 / 255) ** 2.2, rtol=1e-5)
    assert stack.saturated is not None
    assert stack.saturated[3, :, :, 0].all()
    assert not stack.saturated[:3].any()


def test_binning_averages_linear_values(card: Path, tmp_path: Path) -> None:
    arguments = ("--positions", "positions.csv", "--width-mm", "32", "--gamma", "2.2", "--bin", "4")
    assert run(card, *arguments, "-o", tmp_path / "c.stack.h5") == 0
    stack = read_stack(tmp_path / "c.stack.h5")
    assert stack.radiance.shape == (4, 3, 4, 3)
    assert stack.pixel_pitch == pytest.approx(8.0)


def test_display_pictures_without_a_stated_gamma_are_refused(
    card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("--positions", "positions.csv", "--width-mm", "32", "-o", tmp_path / "c.stack.h5")
    assert run(card, *arguments) == 2
    message = capsys.readouterr().err
    assert message.count("state --gamma") == 4
    assert not (tmp_path / "c.stack.h5").exists()


def test_all_that_is_wrong_with_a_table_is_said_at_once_by_line(
    card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = ["file,camera_x_mm,camera_y_mm,camera_z_mm", "0.png,1,2,x", "1.png,0,0,-5", "2.png,0,0,nan"]
    (card / "bad.csv").write_text("\n".join(rows))
    arguments = ("--positions", "bad.csv", "--width-mm", "32", "--gamma", "1", "-o", tmp_path / "c.stack.h5")
    assert run(card, *arguments) == 2
    message = capsys.readouterr().err
    assert all(f"bad.csv:{line}" in message for line in (2, 3, 4))


def test_missing_and_damaged_pictures_are_named(card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (card / "1.png").unlink()
    (card / "2.png").write_bytes(b"no picture")
    arguments = ("--positions", "positions.csv", "--width-mm", "32", "--gamma", "1", "-o", tmp_path / "c.stack.h5")
    assert run(card, *arguments) == 2
    message = capsys.readouterr().err
    assert "1.png is not in" in message
    assert "2.png cannot be read" in message


def test_a_table_without_the_needed_columns_is_refused_with_what_is_needed(
    card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (card / "bad.csv").write_text("name,x\n0.png,1\n")
    arguments = ("--positions", "bad.csv", "--width-mm", "32", "--gamma", "1", "-o", tmp_path / "c.stack.h5")
    assert run(card, *arguments) == 2
    assert "needed are file, camera_x_mm" in capsys.readouterr().err


def test_the_torch_beside_a_phones_lens_is_found_in_a_real_capture(tmp_path: Path) -> None:
    if not (SHARED / "real_card").is_dir():
        pytest.skip(f"the real capture is not at {SHARED / 'real_card'}; set HALFANGLE_SHARED_DATA")
    arguments = ("--positions", "positions.csv", "--width-mm", "68.48", "--gamma", "2.2", "--bin", "8")
    assert run(SHARED / "real_card", *arguments, "-o", tmp_path / "card.stack.h5") == 0
    offset = pooled_light_offset(read_stack(tmp_path / "card.stack.h5"))
    # By its highlights the torch stands about 1.1 cm from the lens.
    assert 9.5 < np.hypot(*offset.value[:2]) < 13.0


def table(card: Path, text: str) -> tuple[str | Path, ...]:
    (card / "table.csv").write_text(text, encoding="utf-8")
    return (card, "--positions", "table.csv", "--width-mm", "32", "--gamma", "2.2")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "file,camera_x_cm,camera_y_cm,camera_z_cm,light_x_cm,light_y_cm\n0.png,0,0,17,1,1\n",
            "light_z_cm is missing; a light needs x, y and z",
        ),
        ("file,camera_x_cm,camera_y_cm,camera_z_cm,tilt\n0.png,0,0,17,3\n", "column 'tilt' is not known"),
        (
            "file,camera_x_cm,camera_y_cm,camera_z_cm\n0.png,0,0,17\n0.png,1,0,17\n",
            "table.csv:3: 0.png stands in line 2 already",
        ),
        ("file,camera_x_mm,camera_y_mm,camera_z_mm\n0.png,0,0,0.17\n", "In metres or centimetres?"),
        ("file,camera_x_cm,camera_y_cm,camera_z_cm\n0.png,1,5,0,0,17,0\n", "a decimal comma? Use the decimal point"),
        (
            "file,camera_x_cm,camera_y_cm,camera_z_cm,light_x_mm,light_y_cm,light_z_cm\n0.png,0,0,17,1,1,17\n",
            "have several units",
        ),
    ],
)
def test_half_understood_tables_are_refused_with_the_remedy(
    card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, told: str
) -> None:
    assert run(*table(card, text), "-o", tmp_path / "c.stack.h5") == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "c.stack.h5").exists()


def test_semicolons_and_decimal_commas_are_read(card: Path, tmp_path: Path) -> None:
    rows = ["file;camera_x_cm;camera_y_cm;camera_z_cm", *(f"{i}.png;{i},5;0;17,25" for i in range(4))]
    assert run(*table(card, "\n".join(rows)), "-o", tmp_path / "c.stack.h5") == 0
    np.testing.assert_allclose(read_stack(tmp_path / "c.stack.h5").camera_position[2], [25.0, 0.0, 172.5])


LP = ("--positions", "dome.lp", "--width-mm", "32", "--gamma", "1")


def test_the_light_directions_of_a_dome_are_read(card: Path, tmp_path: Path) -> None:
    """With paths of the computer on which they were found, and a camera that looks straight down."""
    names = ["scans/of/somebody/0.png", "D:\\scans\\1.png", "2.png", "./3.png"]
    rows = [f"{name} {0.1 * i} -0.2 0.9" for i, name in enumerate(names)]
    (card / "dome.lp").write_text("\n".join(["4", *rows, ""]))
    assert run(card, *LP, "-o", tmp_path / "c.stack.h5") == 0
    stack = read_stack(tmp_path / "c.stack.h5")
    np.testing.assert_allclose(stack.camera_position[:, :2], 0.0)
    direction = stack.light_position / np.linalg.norm(stack.light_position, axis=1, keepdims=True)
    np.testing.assert_allclose(direction[3], np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9]))
    # Of a dome only directions are known: no pixel has more light than another.
    assert np.ptp(np.linalg.norm(stack.light_position, axis=1)) < 1.0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "number of pictures"),
        ("0.png 0.1 0.2 0.97\n", "number of pictures"),
        ("2\n0.png 0.1 0.2 0.97\n", "says 2 pictures; 1 lines follow"),
        ("1\n0.png 0.1 0.2\n", "dome.lp:2"),
        ("1\n0.png 0.1 0.2 -0.9\n", "z above the sample"),
        ("1\n0.png 0 0 nan\n", "z above the sample"),
    ],
)
def test_a_file_of_directions_that_is_none_is_refused(
    card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, told: str
) -> None:
    (card / "dome.lp").write_text(text)
    assert run(card, *LP, "-o", tmp_path / "c.stack.h5") == 2
    assert told in capsys.readouterr().err


@pytest.mark.parametrize("number", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("option", ["--width-mm", "--gamma"])
def test_an_option_is_a_finite_number(
    card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, number: str
) -> None:
    others = {"--width-mm": "32", "--gamma": "2.2"} | {option: number}
    given = [text for pair in others.items() for text in pair]
    assert run(card, "--positions", "positions.csv", *given, "-o", tmp_path / "c.stack.h5") == 2
    assert option in capsys.readouterr().err


def test_a_picture_of_one_row_is_refused(card: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite(str(card / "2.png"), np.full((1, 64), 99, np.uint8))
    arguments = ("--positions", "positions.csv", "--width-mm", "32", "--gamma", "2.2", "-o", tmp_path / "c.stack.h5")
    assert run(card, *arguments) == 2
    assert "2.png cannot be read as a picture (has 64 x 1 pixels" in capsys.readouterr().err


@pytest.mark.parametrize("scale", [1e-9, 1.0, 30.0, 1e9])
def test_pictures_of_floating_point_numbers_have_any_unit_and_no_clipped_pixel(
    card: Path, tmp_path: Path, scale: float
) -> None:
    radiance = np.random.default_rng(3).uniform(0.2, 1.5, (4, 12, 16, 3))
    for i in range(4):
        np.save(card / f"{i}.npy", (scale * radiance[i]).astype(np.float32))
    text = (card / "positions.csv").read_text().replace(".png", ".npy")
    (card / "npy.csv").write_text(text)
    assert run(card, "--positions", "npy.csv", "--width-mm", "32", "-o", tmp_path / "c.stack.h5") == 0
    stack = read_stack(tmp_path / "c.stack.h5")
    np.testing.assert_allclose(stack.radiance, scale * radiance, rtol=1e-6)
    assert stack.saturated is not None
    assert not stack.saturated.any()
    assert stack.variance is not None
    np.testing.assert_allclose(np.sqrt(stack.variance) / stack.radiance, 0.005, rtol=0.01)


def test_sixteen_bits_clip_at_their_own_top_and_step_by_their_own_step(card: Path, tmp_path: Path) -> None:
    for i in range(4):
        picture = np.full((12, 16), 65_400, np.uint16)
        picture[0, 0] = 65_535
        picture[1, 1] = 40
        cv2.imwrite(str(card / f"{i}.png"), picture)
    arguments = ("--positions", "positions.csv", "--width-mm", "32", "--gamma", "1", "-o", tmp_path / "c.stack.h5")
    assert run(card, *arguments) == 0
    stack = read_stack(tmp_path / "c.stack.h5")
    assert stack.saturated is not None
    assert stack.saturated[0].sum() == 1
    assert stack.variance is not None
    assert np.sqrt(stack.variance[0, 1, 1, 0]) < 2.0 / 65_535
