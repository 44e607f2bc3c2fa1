"""`halfangle console` where it cannot open."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from cli.main import halfangle
from tests.cli.test_capture import RIG


@pytest.fixture
def rig(tmp_path: Path) -> str:
    (tmp_path / "rig.toml").write_text(RIG)
    return str(tmp_path / "rig.toml")


@pytest.mark.skipif("sys.platform != 'linux'", reason="other desktops are always there")
def test_without_a_display_it_says_so_and_what_needs_none(rig: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    refused = CliRunner().invoke(halfangle, ["console", "--rig", rig])
    assert refused.exit_code == 1
    assert "there is no display for the window" in refused.output
    assert "halfangle capture" in refused.output


def test_a_rig_file_with_mistakes_is_refused_before_a_window_opens(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG.replace("working_distance_mm", "working_distance"))
    refused = CliRunner().invoke(halfangle, ["console", "--rig", str(tmp_path / "rig.toml")])
    assert "working_distance" in str(refused.exception)
    assert "Did you mean" in str(refused.exception) or "did you mean" in str(refused.exception)


def test_a_script_of_faults_with_mistakes_is_refused_too(rig: str, tmp_path: Path) -> None:
    (tmp_path / "faults.toml").write_text('[[faults]]\ndevice = "lamp"\neffect = "lost"\n')
    refused = CliRunner().invoke(halfangle, ["console", "--rig", rig, "--faults", str(tmp_path / "faults.toml")])
    assert "lamp" in str(refused.exception)
