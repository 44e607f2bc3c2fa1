"""The examples of docs/python.md do what they say."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib as mpl
import pytest

from analysis import Options, reconstruct, write_result, write_stack
from benchmarks.common.simulated import EXAMPLES
from instrument import load_protocol, load_rig
from protocols.capture import capture
from tests.synthetic import make_stack

PAGE = Path(__file__).parents[1] / "docs" / "python.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
TITLES = ("three calls", "a folder of sessions", "two dictionaries", "maps")
PROTOCOL = """
name = "few poses"
bracket = { exposure_times_s = [0.004, 0.016, 0.064], darks = 2 }
rings = [
    { tilt_deg = 0.0, count = 1 },
    { tilt_deg = 25.0, count = 5 },
    { tilt_deg = 45.0, count = 5, start_deg = 20.0 },
]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stack and its result, each where the examples look for it."""
    folder = tmp_path_factory.mktemp("python")
    write_stack(folder / "area.stack.h5", make_stack(n_views=12, size=12))
    result = reconstruct(folder / "area.stack.h5", Options(accuracy="draft", palette="off"), n_held_out=0)
    write_result(folder / "area.result.h5", result)
    return folder


def run(block: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    mpl.use("Agg")
    exec(compile(block, str(PAGE), "exec"), {"__name__": "__main__"})


def block(title: str) -> str:
    assert len(BLOCKS) == len(TITLES)
    return dict(zip(TITLES, BLOCKS, strict=True))[title]


@pytest.mark.slow
def test_a_folder_of_sessions_is_reprocessed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "few.toml").write_text(PROTOCOL, encoding="utf-8")
    (tmp_path / "sessions").mkdir()
    session = tmp_path / "sessions" / "leaf.h5"
    capture(load_rig(EXAMPLES / "simulated.toml"), load_protocol(tmp_path / "few.toml"), session)
    run(block("a folder of sessions"), tmp_path, monkeypatch)
    assert re.search(r"leaf\.h5: normals to \d\.\d\d deg", capsys.readouterr().out)
    for end in (".stack.h5", ".result.h5", ".html"):
        assert session.with_suffix(end).exists()


def test_two_dictionaries_are_compared_on_one_stack(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(block("two dictionaries"), folder, monkeypatch)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["parametric", "abc"]


def test_maps_are_read_and_plotted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(block("maps"), folder, monkeypatch)
    assert (folder / "maps.png").stat().st_size > 10_000


def test_three_calls_make_a_report(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The stack is there already; that it is made of a session is shown above.
    text = block("three calls").replace('calibrate("session.h5", "area.stack.h5")\n', "")
    assert text.count("\n") == block("three calls").count("\n") - 1
    run(text, folder, monkeypatch)
    assert "Stated normal sigma" in (folder / "report.html").read_text(encoding="utf-8")
