"""The commands that work on stacks and results, run as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import OpenEXR
import pytest

from analysis.registration.stack_file import read_stack, write_stack
from analysis.results.points import USES
from cli.main import main
from tests.synthetic import make_stack


def run(*arguments: str | Path) -> int:
    """Run `halfangle` and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a stack and its result."""
    made = tmp_path_factory.mktemp("commands")
    write_stack(made / "area.stack.h5", make_stack(n_views=30, size=24))
    arguments = (made / "area.stack.h5", "-o", made / "area.result.h5", "--json", made / "area.json", "-q")
    assert run("reconstruct", *arguments, "--left-out", "2") == 0
    return made


def test_reconstruct_writes_the_maps_that_the_format_promises(folder: Path) -> None:
    with h5py.File(folder / "area.result.h5") as file:
        maps = file["/entry/result"]
        assert maps["normals"].shape == (24, 24, 3)
        assert maps["normals"].dtype == np.float32
        np.testing.assert_allclose(np.linalg.norm(maps["normals"], axis=-1), 1.0, atol=1e-5)
        for name in ("normal_sigma_deg", "depth", "depth_sigma", "model", "flags", "material"):
            assert maps[name].shape == (24, 24), name
        assert maps["diffuse_albedo"].shape == (24, 24, 3)
        assert abs(float(np.mean(maps["depth"]))) < 1e-6


def test_reconstruct_writes_the_figures_that_a_program_reads(folder: Path) -> None:
    figures = json.loads((folder / "area.json").read_text())
    assert figures["normal_error_deg"]["mean"] < 0.3
    assert figures["depth_rmse_mm"] < 0.05
    assert len(figures["left_out"]) == 2
    assert {"name", "seconds", "peak_mb"} <= set(figures["stages"][0])
    assert all(choice["reason"] for choice in figures["choices"])


def test_render_predicts_a_view_of_the_stack_in_its_own_units(folder: Path) -> None:
    stack = read_stack(folder / "area.stack.h5")
    camera = ",".join(str(x) for x in stack.camera_position[7])
    assert run("render", folder / "area.result.h5", "--camera", camera, "--light", camera, "-o", folder / "p.npy") == 0
    predicted = np.load(folder / "p.npy")
    measured = stack.radiance[7]
    assert predicted.shape == measured.shape
    assert np.sqrt(np.mean((predicted - measured) ** 2) / np.mean(measured**2)) < 0.03


def test_render_writes_exr_and_png_too(folder: Path) -> None:
    for name in ("p.exr", "p.png"):
        where = ("--camera", "0,0,350", "--light", "150,0,300")
        assert run("render", folder / "area.result.h5", *where, "-o", folder / name) == 0
    with OpenEXR.File(str(folder / "p.exr")) as file:
        assert file.channels()["RGB"].pixels.shape == (24, 24, 3)


def test_relight_writes_a_page_and_says_how_pixels_are_shown(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("relight", folder / "area.result.h5", "-o", folder / "relit.html") == 0
    told = capsys.readouterr().out
    assert "24 x 24 pixels" in told
    assert "palette" in told
    assert "own atoms" in told
    assert run("relight", folder / "area.result.h5", "-o", folder / "relit.html") == 2
    assert "is not overwritten" in capsys.readouterr().err


def test_the_report_is_one_page_that_needs_nothing_beside_it(folder: Path) -> None:
    assert run("report", folder / "area.result.h5", "-o", folder / "page.html") == 0
    page = (folder / "page.html").read_text()
    assert "data:image/png;base64," in page
    assert "http" not in page.split("<style>")[1]
    assert "Views left out" in page
    assert "Plane and bowl in the depth" in page


def test_point_prints_the_samples_of_a_pixel_beside_its_curve(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("point", folder / "area.result.h5", "3", "5", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["row"], found["column"]) == (3, 5)
    f, theta_h = np.array(found["samples"]["f"], float), np.array(found["samples"]["theta_h_rad"])
    assert f.shape == (30, 3)
    curve = np.array(found["curve"]["f"])
    fitted = np.stack([np.interp(theta_h, found["curve"]["theta_h_rad"], c) for c in curve.T], axis=1)
    used = np.array(found["samples"]["use"]) == "used"
    assert used.mean() > 0.8
    assert np.abs((f / fitted - 1.0)[used]).mean() < 0.05
    assert run("point", folder / "area.result.h5", "3", "5") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("row 3, column 5: seen from ")
    assert len([line for line in lines if line.endswith(tuple(USES))]) == 90


def test_export_writes_maps_and_says_how_true_they_are(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("export", folder / "area.result.h5", "-o", folder / "maps", "--crop", "4,4,16,12") == 0
    told = capsys.readouterr().out
    assert "size        6.4 x 4.8 mm, 16 x 12 pixels" in told
    assert told.count(" dB  mean dE00 ") == 5
    figures = json.loads((folder / "maps/export.json").read_text())
    assert figures["pixels"] == [16, 12]
    assert figures["result"] == "area.result.h5"
    assert min(error["psnr_db"] for error in figures["errors"][:3]) > 33.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("export", "R", "-o", "x.maps", "--crop", "0,0,5"), "--crop: is '0,0,5'; must be X,Y,WIDTH,HEIGHT in pixels"),
        (("export", "R", "-o", "x.maps", "--crop", "0,0,50,5"), "the area has 24 x 24 pixels"),
        (("export", "R", "-o", "x.maps", "--resolution", "99"), "no more than 24 pixels were measured"),
        (("export", "R", "-o", "x.maps", "--mesh", "9"), "--mesh: is for --to gltf"),
        (("export", "R", "-o", "R"), "exists and is not overwritten"),
        (("point", "R", "99", "5"), "rows are 0 to 23"),
        (("point", "R", "3", "5", "--stack", "nowhere.stack.h5"), "is not there; put area.stack.h5"),
        (("point", "R", "3", "5", "--stack", "R"), "is not the file that area.result.h5 came from"),
        (("render", "R", "--camera", "0,0", "--light", "0,0,9", "-o", "x.npy"), "--camera: is '0,0'; must be X,Y,Z"),
        (("render", "R", "--camera", "0,0,-5", "--light", "0,0,9", "-o", "x.npy"), "with Z above the sample"),
        (("render", "R", "--camera", "0,0,5", "--light", "0,0,9", "-o", "x.bmp"), "pictures are written as .exr"),
        (("reconstruct", "nowhere.stack.h5", "-o", "x.h5"), "no such file"),
        (("report", "S", "-o", "x.html"), "/entry/result/normals: is missing"),
        (("reconstruct", "S", "-o", "no/folder/x.h5"), "is no folder"),
        (("reconstruct", "S", "-o", "R"), "exists and is not overwritten"),
    ],
)
def test_bad_input_ends_with_code_2_a_message_and_nothing_written(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    names = {"S": folder / "area.stack.h5", "R": folder / "area.result.h5"}
    filled = [names.get(a, tmp_path / a if a.startswith(("x.", "no/", "nowhere")) else a) for a in arguments]
    assert run(*filled) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_one_view_is_refused_with_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_stack(tmp_path / "one.stack.h5", make_stack(n_views=1, size=8))
    assert run("reconstruct", tmp_path / "one.stack.h5", "-o", tmp_path / "r.h5", "-q") == 2
    assert "1 views; at least 4 are needed" in capsys.readouterr().err
    assert not (tmp_path / "r.h5").exists()


def test_a_stack_that_was_cut_short_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = (folder / "area.stack.h5").read_bytes()
    (tmp_path / "cut.stack.h5").write_bytes(whole[: len(whole) // 2])
    assert run("reconstruct", tmp_path / "cut.stack.h5", "-o", tmp_path / "r.h5", "-q") == 2
    assert "the file is damaged or cut short" in capsys.readouterr().err
    assert not (tmp_path / "r.h5").exists()


def test_the_dictionaries_can_be_listed_and_looked_at(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("dictionary", "list") == 0
    assert "300 atoms" in capsys.readouterr().out
    assert run("dictionary", "info", "parametric") == 0
    assert "lambert" in capsys.readouterr().out


@pytest.mark.parametrize(
    "command",
    ["demo", "calibrate", "reconstruct", "render", "report", "point", "import", "dictionary", "plan", "console"],
)
def test_every_command_has_help_with_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(command, "--help") == 0
    assert "halfangle" in capsys.readouterr().out
