"""The example of a driver in a package of its own, installed as its manual says."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "examples" / "driver_package"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    options = ["-q", "--no-index", "--no-build-isolation", "--no-deps", "--no-compile", "--target", str(folder)]
    source = folder.parent / "source"
    # A build leaves traces beside the sources.
    subprocess.run(["cp", "-r", PACKAGE, source], check=True)
    subprocess.run([sys.executable, "-m", "pip", "install", *options, source], check=True, timeout=120)
    return folder


@pytest.fixture
def led(tmp_path: Path) -> Path:
    folder = tmp_path / "leds" / "sample-light"
    folder.mkdir(parents=True)
    for name, value in {"max_brightness": "255", "brightness": "7", "trigger": "[heartbeat] none"}.items():
        (folder / name).write_text(value)
    return folder


@pytest.fixture
def rig(tmp_path: Path, led: Path) -> Path:
    text = (PACKAGE / "rig.toml").read_text()
    path = tmp_path / "rig.toml"
    path.write_text(text.replace('led = "sample-light"', f'led = "sample-light"\nfolder = "{led.parent}"'))
    return path


def halfangle(site: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from cli.main import main; main()", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": f"{site}:{ROOT}"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)


def test_its_light_passes_the_tests_that_every_light_passes(site: Path, rig: Path, led: Path):
    done = halfangle(site, "driver-test", rig, "--kind", "light", "--yes")
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout
    assert (led / "brightness").read_text() == "0"
    assert (led / "trigger").read_text() == "none"


@pytest.mark.slow
def test_a_driver_that_does_not_keep_its_word_fails_them(site: Path, rig: Path, led: Path):
    # Half of three steps is none of them.
    (led / "max_brightness").write_text("3")
    done = halfangle(site, "driver-test", rig, "--kind", "light", "--yes")
    assert done.returncode == 1
    assert "test_shines_at_the_level_it_is_told FAILED" in done.stdout
    assert (led / "brightness").read_text() == "0"


def test_without_the_package_its_driver_is_unknown(rig: Path, tmp_path: Path):
    done = halfangle(tmp_path, "rig", "check", rig)
    assert done.returncode == 2
    assert "light.driver is 'sysfs_led'; known drivers of a light: simulated, scpi, serial." in done.stderr


def test_its_table_is_checked_like_any_other(site: Path, rig: Path):
    rig.write_text(rig.read_text().replace('led = "sample-light"', "longest_lease_s = 0"))
    done = halfangle(site, "rig", "check", rig)
    assert done.returncode == 2
    assert "the key 'led' is missing in [light.device]" in done.stderr
    assert "light.device.longest_lease_s is 0; it must be greater than 0" in done.stderr


def test_its_errors_come_through_the_process_that_owns_the_light(site: Path, rig: Path):
    rig.write_text(rig.read_text().replace('led = "sample-light"', 'led = "lamp"'))
    done = halfangle(site, "rig", "check", rig)
    assert done.returncode == 1
    assert "FAIL  light   there is no LED 'lamp'; LEDs here: sample-light. Correct led in rig.toml" in done.stdout
