import json
from pathlib import Path

from instrument.session.audit import AuditLog, beside, event_line
from instrument.session.layout import MAX_EVENT


def numbers(path: Path) -> list[int]:
    return [json.loads(line)["n"] for line in beside(path).read_text().splitlines()]


def test_nothing_is_written_before_the_capture_begins(tmp_path: Path) -> None:
    log = AuditLog(tmp_path / "s.h5")
    log.note("connected", serial="one")
    assert list(tmp_path.iterdir()) == []
    log.begin()
    log.note("light on")
    assert numbers(tmp_path / "s.h5") == [0, 1]
    log.close()
    log.note("after the end")
    assert [json.loads(line)["event"] for line in log.take()] == ["connected", "light on", "after the end"]


def test_a_resumed_log_goes_on_and_gives_the_session_what_a_kill_kept_from_it(tmp_path: Path) -> None:
    first = AuditLog(tmp_path / "s.h5")
    first.begin()
    for event in ("a", "b", "c"):
        first.note(event)
    first.close()
    # The session had been given one line; the last one of the file was torn by the kill.
    with beside(tmp_path / "s.h5").open("a") as file:
        file.write('{"n": 3, "ev')
    second = AuditLog(tmp_path / "s.h5", n_kept=1)
    second.begin()
    second.note("d")
    assert [json.loads(line)["event"] for line in second.take()] == ["b", "c", "d"]
    second.close()
    assert [json.loads(line)["n"] for line in second.path.read_text().splitlines() if line.endswith("}")] == [
        0,
        1,
        2,
        3,
    ]


def test_a_log_that_is_gone_is_begun_anew_after_the_lines_of_the_session(tmp_path: Path) -> None:
    log = AuditLog(tmp_path / "s.h5", n_kept=7)
    log.begin()
    log.note("resumed")
    log.close()
    assert numbers(tmp_path / "s.h5") == [7]


def test_a_line_fits_its_place_in_a_session_whatever_it_says() -> None:
    for details in (
        {"why": "x" * 5000},
        {"why": "\u00e4" * 5000, "more": ["y" * 300] * 50},
        {f"key{i}": "z" * 100 for i in range(200)},
    ):
        line = event_line("failed", details)
        assert len(line.encode()) <= MAX_EVENT
        assert json.loads(line)["event"] == "failed"
    assert json.loads(event_line("move", {"tilt": 1.5}))["tilt"] == 1.5
