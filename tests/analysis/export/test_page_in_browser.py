"""The page that relights, opened from a file in Chromium: what its shader computes is what the result renders."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.export.page.page import write_relighting_page
from analysis.reflectance.dictionary import from_published, parametric
from analysis.results.result import Result
from tests.analysis.export.gltf_shading import psnr
from tests.analysis.export.own_atoms import result_of
from tests.analysis.export.scene import small_result
from tests.analysis.export.test_page import PLACES, rendered

BROWSER = next((path for name in ("chromium", "google-chrome") if (path := shutil.which(name))), None)

pytestmark = pytest.mark.skipif(BROWSER is None, reason="neither chromium nor google-chrome is installed")

FLAGS = (
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist", "--force-device-scale-factor=1", "--virtual-time-budget=60000",
)  # fmt: skip

Array = NDArray[np.float64]


def browse(page: Path, wishes: str, *flags: str) -> str:
    """Open a page in a browser of its own; return the document as it is in the end."""
    command = [str(BROWSER), *FLAGS, f"--user-data-dir={page.parent / 'profile'}", *flags, f"{page.as_uri()}#{wishes}"]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout


def shaded(page: Path, camera: Array, light: Array, layer: str = "relit") -> Array:
    """Return what the shader computes, (P, 4)."""
    numbers = ",".join(f"{x:.9g}" for x in (*camera, *light))
    document = browse(page, f"layer={layer}&test={numbers}", "--dump-dom")
    message = re.search(r'id="message"[^>]*>([^<]*)<', document)
    assert message, document[-2000:]
    assert message.group(1) == ""
    found = re.search(r'<pre id="test"[^>]*>([^<]+)</pre>', document)
    assert found, "the page wrote no numbers"
    return np.frombuffer(base64.b64decode(found.group(1)), "<f4").reshape(-1, 4).astype(np.float64)


@pytest.fixture(scope="module")
def palette(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """A result with a palette, and its page."""
    result, page = small_result(), tmp_path_factory.mktemp("palette") / "page.html"
    write_relighting_page(page, result)
    return result, page


@pytest.mark.parametrize("place", range(len(PLACES)))
def test_palette_pixels_are_as_rendered(place: int, palette: tuple[Result, Path]) -> None:
    result, page = palette
    expected, found = rendered(result, *PLACES[place]), shaded(page, *PLACES[place])
    np.testing.assert_array_equal(found[:, 3] == 0.0, np.isnan(expected[:, 0]))
    assert psnr(expected, found[:, :3]) > 80.0


@pytest.mark.parametrize("name", ["parametric", "sgd", "abc"])
def test_pixels_with_atoms_of_their_own_are_as_rendered(name: str, tmp_path: Path) -> None:
    result = result_of(parametric() if name == "parametric" else from_published(name))
    write_relighting_page(tmp_path / "page.html", result)
    found = shaded(tmp_path / "page.html", *PLACES[2])[:, :3]
    assert psnr(rendered(result, *PLACES[2]), found) > 80.0


def test_the_layers_show_the_maps(palette: tuple[Result, Path]) -> None:
    result, page = palette
    solved = np.isfinite(result.fits.normals[:, 0])
    normals = shaded(page, *PLACES[0], layer="normals")[solved, :3]
    np.testing.assert_allclose(2.0 * normals - 1.0, result.fits.normals[solved], atol=1e-4)
    weights = shaded(page, *PLACES[0], layer="materials")[solved, :3]
    assert len(np.unique(weights.round(3), axis=0)) >= 5


def test_the_picture_is_drawn_upright_and_tilted(palette: tuple[Result, Path], tmp_path: Path) -> None:
    result, page = palette
    pictures = []
    for name, wishes in (("flat", ""), ("tilted", "tilt_x=-50")):
        shot = tmp_path / f"{name}.png"
        browse(page, wishes, f"--screenshot={shot}", "--window-size=1000,700")
        pictures.append(cv2.imread(str(shot))[:, :690])
    assert all(drawn is not None for drawn in pictures)
    background = np.array([36, 33, 32])
    inside = [np.abs(drawn.astype(int) - background).max(axis=2) > 12 for drawn in pictures]
    heights = [int(np.ptp(np.flatnonzero(mask.any(axis=1)))) for mask in inside]
    assert heights[1] < 0.85 * heights[0]
    rows = [np.flatnonzero(mask.any(axis=1)) for mask in inside]
    top, bottom = (np.count_nonzero(inside[1][row]) for row in (rows[1][6], rows[1][-6]))
    assert top < bottom, "the upper edge leans away, so it is the shorter one"
    assert result.grid.height == result.grid.width


HANDS = """
<script>
const canvas = document.getElementById("picture"), seen = [];
canvas.setPointerCapture = () => {};  // there is no pointer here that could be caught
const pointer = (kind, x, y, more) => canvas.dispatchEvent(
  new PointerEvent(kind, { pointerId: 1, clientX: x, clientY: y, bubbles: true, ...more }));
const key = (name, more) => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: name, ...more }));
const note = () => seen.push({ ...state });
const waiting = setInterval(() => {
  if (!window.halfangle) return;
  clearInterval(waiting);
  const box = canvas.getBoundingClientRect(), radius = 0.5 * Math.min(box.width, box.height);
  const [x, y] = [box.left + 0.5 * box.width, box.top + 0.5 * box.height];
  pointer("pointerdown", x + 0.5 * radius, y); pointer("pointermove", x - 0.25 * radius, y - 0.5 * radius);
  pointer("pointerup", x, y); pointer("pointermove", x, y); note();
  pointer("pointerdown", x, y, { shiftKey: true }); pointer("pointermove", x + 50, y + 25);
  pointer("pointerup", x, y); note();
  key("ArrowRight"); key("ArrowUp", { shiftKey: true }); key("+"); note();
  pointer("pointerdown", box.left, box.top); pointer("pointerup", x, y); note();
  const layer = document.getElementById("layer");
  layer.value = "sigma"; layer.dispatchEvent(new Event("input")); note();
  key("Home"); note();
  document.getElementById("test").textContent = JSON.stringify(seen);
}, 50);
</script>
"""


def test_light_tilt_and_exposure_follow_hand_and_keys(palette: tuple[Result, Path], tmp_path: Path) -> None:
    moved = tmp_path / "moved.html"
    moved.write_text(palette[1].read_text(encoding="utf-8").replace("</body>", f"{HANDS}</body>"), encoding="utf-8")
    found = re.search(r'<pre id="test"[^>]*>([^<]+)</pre>', browse(moved, "", "--dump-dom"))
    assert found
    dragged, tilted, pressed, at_edge, layered, reset = json.loads(found.group(1))
    assert (dragged["light_x"], dragged["light_y"]) == pytest.approx((-0.25, 0.5), abs=0.01)
    assert (tilted["tilt_x"], tilted["tilt_y"]) == pytest.approx((10.0, 20.0))
    assert (tilted["light_x"], tilted["light_y"]) == (dragged["light_x"], dragged["light_y"])
    assert pressed["light_x"] == pytest.approx(tilted["light_x"] + 0.03)
    assert (pressed["tilt_x"], pressed["exposure"]) == pytest.approx((8.0, 0.25))
    assert np.hypot(at_edge["light_x"], at_edge["light_y"]) == pytest.approx(0.985)
    assert layered["layer"] == "sigma"
    assert (reset["layer"], reset["tilt_x"], reset["exposure"]) == ("relit", 0, 0)
