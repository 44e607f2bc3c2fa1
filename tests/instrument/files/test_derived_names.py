"""Names of what is made of a session."""

import os
from pathlib import Path

import pytest

from instrument.files import derived_names


@pytest.mark.parametrize("name", ["a.b.h5", "a.b.stack.h5", "a.b.result.h5", "a.b.calibration.json", "a.b.html"])
def test_all_files_of_a_session_know_its_name(name: str):
    assert derived_names.name_of(Path(name)) == "a.b"


def test_new_files_have_one_number_that_none_of_them_had(tmp_path: Path):
    session = tmp_path / "a.h5"
    assert [f.name for f in derived_names.free(session, derived_names.STACK, derived_names.REPORT)] == [
        "a.stack.h5",
        "a.html",
    ]
    (tmp_path / "a.html").touch()
    (tmp_path / "a-2.stack.h5").touch()
    assert [f.name for f in derived_names.free(session, derived_names.STACK, derived_names.REPORT)] == [
        "a-3.stack.h5",
        "a-3.html",
    ]


def test_what_was_made_of_a_session_is_found_the_newest_first(tmp_path: Path):
    for age, name in enumerate(["a-2.stack.h5", "a.stack.h5", "a-b.stack.h5", "b.stack.h5", "axh5.stack.h5"]):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    (tmp_path / "a-3.stack.h5").mkdir()
    assert [f.name for f in derived_names.made(tmp_path / "a.h5", derived_names.STACK)] == [
        "a-2.stack.h5",
        "a.stack.h5",
    ]
