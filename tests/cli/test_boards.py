"""`halfangle boards`: files to print, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from cli.main import main

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(*arguments: str | Path) -> int:
    """Run `halfangle boards` and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main(["boards", *(str(argument) for argument in arguments)])
    return int(ended.value.code or 0)


def test_boards_of_a_rig_are_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(EXAMPLES / "simulated.toml", "-o", tmp_path / "rig.pdf") == 0
    assert "4 boards on 1 page of a4, 210 x 297 mm. Print at 100 %" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["rig.pdf"]


def test_proposed_boards_come_with_tables_that_draw_the_same(tmp_path: Path) -> None:
    assert run("--area-mm", "60", "60", "-o", tmp_path / "new.pdf") == 0
    assert run(tmp_path / "new.toml", "-o", tmp_path / "again.pdf") == 0
    assert (tmp_path / "new.pdf").read_bytes() == (tmp_path / "again.pdf").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("-o", "a.pdf"), "give either FILE or --area-mm"),
        (("--area-mm", "60", "60", "-o", "a.toml"), "give a name that ends in .pdf"),
        (("--area-mm", "300", "300", "-o", "a.pdf"), "a3 has 297 x 420 mm"),
        (("--area-mm", "nan", "60", "-o", "a.pdf"), "no finite number"),
        (("missing.toml", "-o", "a.pdf"), "cannot be read"),
    ],
)
def test_what_cannot_be_drawn_is_refused_and_nothing_written(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    told: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_files_that_are_there_are_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "boards.toml").write_text("mine")
    assert run("--area-mm", "60", "60", "-o", tmp_path / "boards.pdf") == 2
    assert "exists and is not overwritten" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["boards.toml"]
