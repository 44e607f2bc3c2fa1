"""Small pictures of sessions, whatever is beside them."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from instrument.files.child import ReaderEndedError
from instrument.session import layout
from instrument.session_tools import thumbnail
from instrument.session_tools.thumbnail import WIDTH, thumbnails_of


def test_each_session_has_a_picture_and_nothing_else_has(session_path: Path, tmp_path: Path):
    (tmp_path / "damaged.h5").write_bytes(session_path.read_bytes()[:5000])
    pictures = thumbnails_of([tmp_path / "damaged.h5", tmp_path / "gone.h5", session_path])
    assert list(pictures) == [session_path]
    assert pictures[session_path].dtype == np.uint8
    assert pictures[session_path].max() > 0


def test_without_a_pose_there_is_no_picture(changed: Callable[[Callable[[h5py.File], object]], Path]):
    def forget(file: h5py.File) -> None:
        file[layout.POSE_COMPLETE.path][...] = 0

    assert thumbnails_of([changed(forget)]) == {}


@pytest.mark.parametrize("shape", [(60, 80), (200, 320), (320, 200)])
def test_a_preview_is_made_small_and_keeps_its_order_of_brightness(shape: tuple[int, int]):
    preview = np.linspace(0.0, 7.0, shape[0] * shape[1], dtype=np.float32).reshape(shape)
    small = thumbnail.thumbnail(preview)
    assert max(small.shape) <= WIDTH
    assert (np.diff(small.ravel().astype(int)) >= 0).all()
    assert (small[0, 0], small[-1, -1]) == (0, 255)


def test_a_file_that_ends_the_reader_costs_the_others_nothing(session_path: Path, monkeypatch: pytest.MonkeyPatch):
    real = thumbnail.in_child

    def ending(task: str, *paths: Path):
        if paths[0].name == "bad.h5":
            raise ReaderEndedError("crashed")
        yield from real(task, *paths)

    monkeypatch.setattr(thumbnail, "in_child", ending)
    assert list(thumbnails_of([Path("bad.h5"), session_path])) == [session_path]
