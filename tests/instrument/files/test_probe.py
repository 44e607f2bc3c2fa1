"""What ends a reader ends a child process, and the command says so."""

import shutil
import time
from pathlib import Path

import pytest

from cli.main import main
from instrument.files import child
from instrument.files.child import ReaderEndedError, in_child
from instrument.files.probe import UNPACKED, refuse_dangerous
from instrument.files.validation import InvalidInputError
from tests.strangers.traps import crashing, endless, filling


@pytest.fixture(autouse=True)
def impatience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "STEP_SECONDS", 0.3)


@pytest.fixture
def copied(session_path: Path, tmp_path: Path) -> Path:
    path = tmp_path / "s.h5"
    shutil.copy(session_path, path)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InvalidInputError) as caught:
        refuse_dangerous(path)
    return str(caught.value)


def test_a_sound_file_and_one_that_is_not_there_may_be_read(session_path: Path, tmp_path: Path) -> None:
    refuse_dangerous(session_path)
    refuse_dangerous(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("hello")
    refuse_dangerous(tmp_path / "text.h5")


def test_a_frame_that_crashes_its_decoder_is_told_by_its_place(copied: Path) -> None:
    crashing(copied)
    text = refusal(copied)
    assert "images[1, 0, 0, 0]: the file is damaged: a process that was reading this crashed (SIGSEGV)" in text
    # Who does not read frames need not mind.
    refuse_dangerous(copied, UNPACKED)


def test_reading_that_never_ends_is_ended(copied: Path) -> None:
    endless(copied)
    begun = time.monotonic()
    assert "a process that was reading this did not come to an end" in refusal(copied)
    assert time.monotonic() - begun < 60


def test_texts_that_would_fill_the_memory_are_not_read(copied: Path) -> None:
    filling(copied)
    assert "/entry/journal/events: needs more memory" in refusal(copied)


@pytest.mark.parametrize(
    "arguments",
    [
        ("session", "export", "s.h5", "-o", "out"),
        ("session", "pack", "s.h5", "-o", "out"),
        ("calibrate", "s.h5", "-o", "out", "-q"),
        ("reconstruct", "s.h5", "-o", "out", "-q"),
        ("report", "s.h5", "-o", "out"),
        ("render", "s.h5", "--camera", "0,0,300", "--light", "0,0,300", "-o", "out.npy"),
        ("dictionary", "list", "s.h5"),
        ("resume", "s.h5"),
    ],
    ids=" ".join,
)
def test_each_command_survives_a_file_that_crashes_its_reader(
    copied: Path, arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    crashing(copied)
    monkeypatch.chdir(copied.parent)
    with pytest.raises(SystemExit) as caught:
        main(list(arguments))
    assert caught.value.code == 2
    assert "the file is damaged: a process that was reading this crashed" in capsys.readouterr().err
    assert [path.name for path in copied.parent.iterdir()] == ["s.h5"]


def test_a_child_that_says_nothing_for_long_is_given_up(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "SILENCE_SECONDS", 0.001)
    with pytest.raises(ReaderEndedError, match="was stopped"):
        list(in_child("look", copied))


def test_a_module_in_the_folder_of_the_files_is_not_run(
    copied: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (copied.parent / "h5py.py").write_text("open('run', 'w')")
    (copied.parent / "instrument.py").write_text("open('run', 'w')")
    monkeypatch.chdir(copied.parent)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    refuse_dangerous(Path("s.h5"))
    assert not (copied.parent / "run").exists()


def test_nothing_is_left_running(copied: Path) -> None:
    before = children()
    crashing(copied)
    refusal(copied)
    assert children() == before


def children() -> set[str]:
    """The processes that this one has started and that are still there."""
    lists = Path("/proc/self/task").glob("*/children")
    return {number for numbers in lists for number in numbers.read_text().split()}
