"""kill -9 at random times: what was complete stays, and a resumed capture has the frames of a whole one."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest

from instrument.session.session import Session
from tests.campaigns.small_rig import content, ended, processes, run_capture, run_resume
from tests.verifying import verify_session


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, object], float]:
    """The content of an uninterrupted capture, and the seconds that its process took."""
    context, folder = processes(), tmp_path_factory.mktemp("whole")
    for name in ("first.h5", "s.h5"):
        # The first one starts the server of processes, too.
        began = time.monotonic()
        process = context.Process(target=run_capture, args=(str(folder / name),))
        process.start()
        assert ended(process) == 0
    return content(folder / "s.h5"), time.monotonic() - began


def kill_after(seconds: float, target: object, path: Path) -> int:
    process = processes().Process(target=target, args=(str(path),))
    process.start()
    time.sleep(seconds)
    process.kill()
    code = ended(process)
    assert code is not None
    return code


def kill_and_resume(path: Path, whole: tuple[dict[str, object], float], rng: random.Random) -> int:
    """Kill a capture, sometimes its resumption too, and finish it; return how many poses the kill left."""
    expected, duration = whole
    kill_after(rng.uniform(0.0, 1.1 * duration), run_capture, path)
    n_complete = 0
    while path.exists() and rng.random() < 0.3:
        kill_after(rng.uniform(0.0, duration), run_resume, path)
    if path.exists():
        assert list(verify_session(path)) == []
        with Session(path) as session:
            n_complete = int(session.pose_complete.sum())
            before = [session.frames(i).tobytes() for i in range(n_complete)]
        frames = expected["frames"]
        assert isinstance(frames, list)
        assert before == frames[:n_complete]
    process = processes().Process(target=run_resume if path.exists() else run_capture, args=(str(path),))
    process.start()
    assert ended(process) == 0
    assert list(verify_session(path)) == []
    assert content(path) == expected
    return n_complete


def campaign(folder: Path, whole: tuple[dict[str, object], float], n_kills: int, seed: int) -> list[int]:
    rng = random.Random(seed)
    return [kill_and_resume(folder / f"{number}.h5", whole, rng) for number in range(n_kills)]


def test_a_capture_that_is_killed_at_any_time_resumes_to_the_frames_of_a_whole_one(
    tmp_path: Path, whole: tuple[dict[str, object], float]
) -> None:
    assert len(campaign(tmp_path, whole, 8, seed=1)) == 8


@pytest.mark.slow
def test_200_of_200_captures_that_are_killed_at_any_time_resume_to_the_frames_of_a_whole_one(
    tmp_path: Path, whole: tuple[dict[str, object], float]
) -> None:
    # A fresh seed each time; a traceback shows it.
    seed = time.time_ns()
    left = campaign(tmp_path, whole, 200, seed)
    # The moments must be spread over the whole capture for the number to mean anything.
    assert len(set(left)) >= 5
