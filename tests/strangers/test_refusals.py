"""Every reader refuses the same things, by the path of what is wrong and before it takes memory."""

import json
import resource
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import hdf5plugin
import numpy as np
import pytest

from analysis.reflectance.dictionary_file import read_dictionary
from analysis.registration.stack_file import read_stack
from analysis.reporting.result_report import write_report
from analysis.results.result_file import read_result
from instrument.files.validation import InvalidInputError, Problem
from instrument.session import layout
from instrument.session.session import Session

READERS: dict[str, Callable[[Path], object]] = {
    "session": Session,
    "stack": read_stack,
    "result": read_result,
    "dictionary": read_dictionary,
}
# A dataset of numbers of each kind of file, which its reader reads as a whole.
NUMBERS = {
    "session": layout.EXPOSURE_READBACK.path,
    "stack": "/entry/geometry/camera_position",
    "result": "/entry/result/depth",
    "dictionary": "/entry/tables/theta_h",
}

Spoil = Callable[[h5py.File, str], None]


def external_link(file: h5py.File, path: str) -> None:
    del file[path]
    file[path] = h5py.ExternalLink("elsewhere.h5", path)


def soft_link_out(file: h5py.File, path: str) -> None:
    del file[path]
    file["aside"] = h5py.ExternalLink("elsewhere.h5", "/")
    file["between"] = h5py.SoftLink("/aside/x")
    file[path] = h5py.SoftLink("/between")


def virtual(file: h5py.File, path: str) -> None:
    shape = file[path].shape
    del file[path]
    source = h5py.VirtualLayout(shape, "f8")
    source[...] = h5py.VirtualSource("elsewhere.h5", "x", shape)
    file.create_virtual_dataset(path, source)


def stored_elsewhere(file: h5py.File, path: str) -> None:
    shape = file[path].shape
    del file[path]
    file.create_dataset(path, shape, "f8", external=[("/etc/hostname", 0, h5py.h5f.UNLIMITED)])


def scaled(file: h5py.File, path: str) -> None:
    values = file[path][()]
    del file[path]
    file.create_dataset(path, data=values, scaleoffset=3)


def lossy(file: h5py.File, path: str) -> None:
    values = file[path][()]
    del file[path]
    file.create_dataset(path, data=np.resize(values, values.shape), **hdf5plugin.SZ3(absolute=0.1))


def huge_chunks(file: h5py.File, path: str) -> None:
    rank = max(1, file[path].ndim)
    del file[path]
    file.create_dataset(path, (2**29,) * rank, "f8", chunks=(2**28, *(1,) * (rank - 1)), compression="gzip")


def huge(file: h5py.File, path: str) -> None:
    rank = max(1, file[path].ndim)
    del file[path]
    file.create_dataset(path, (2**28, *(1000,) * (rank - 1)), "f8", chunks=(64,) * rank, compression="gzip")


def compound(file: h5py.File, path: str) -> None:
    shape = file[path].shape
    del file[path]
    file.create_dataset(path, shape, np.dtype([("a", "f8"), ("b", "f8")]))


def references(file: h5py.File, path: str) -> None:
    shape = file[path].shape
    del file[path]
    file.create_dataset(path, shape, h5py.ref_dtype)


def a_type(file: h5py.File, path: str) -> None:
    del file[path]
    file[path] = np.dtype("f8")


SPOILS: dict[Spoil, str] = {
    external_link: "link",
    soft_link_out: "link",
    virtual: "takes its values from other files",
    stored_elsewhere: "takes its values from other files",
    scaled: "is packed by HDF5 filter 6; allowed are gzip",
    lossy: "is packed by HDF5 filter 32024",
    huge_chunks: "of more than 1024 MiB each",
    huge: "claims ",
    compound: "has type [('a'",
    references: "has type object",
    a_type: "dataset",
}


def refusal(kind: str, path: Path) -> list[Problem]:
    with pytest.raises(InvalidInputError) as caught:
        READERS[kind](path)
    return list(caught.value.problems)


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("spoil", SPOILS, ids=lambda spoil: spoil.__name__)
def test_every_reader_refuses_by_path(sources: dict[str, Path], tmp_path: Path, kind: str, spoil: Spoil) -> None:
    path, where = tmp_path / "s.h5", NUMBERS[kind]
    shutil.copy(sources[kind], path)
    with h5py.File(path, "r+") as file:
        spoil(file, where)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    problems = refusal(kind, path)
    assert [p for p in problems if p.where == where and SPOILS[spoil] in p.what], "\n".join(map(str, problems))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@pytest.mark.parametrize("kind", ["stack", "result", "dictionary"])
def test_a_soft_link_that_stays_inside_is_followed(sources: dict[str, Path], tmp_path: Path, kind: str) -> None:
    """Other programs that write NeXus use them."""
    path, where = tmp_path / "s.h5", NUMBERS[kind]
    shutil.copy(sources[kind], path)
    with h5py.File(path, "r+") as file:
        file.move(where, "/elsewhere")
        file[where] = h5py.SoftLink("/elsewhere")
    READERS[kind](path)


@pytest.mark.parametrize("kind", READERS)
def test_a_group_that_holds_itself_is_no_trap(sources: dict[str, Path], tmp_path: Path, kind: str) -> None:
    shutil.copy(sources[kind], tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        file["entry/again"] = file["entry"]
        file["entry/round"] = h5py.SoftLink("/entry/round")
    READERS[kind](tmp_path / "s.h5")


def changed_text(source: Path, path: Path, name: str, change: Callable[[str], object]) -> None:
    shutil.copy(source, path)
    with h5py.File(path, "r+") as file:
        file[name][()] = change(file[name].asstr()[()])


def test_a_result_cannot_put_markup_into_a_report(sources: dict[str, Path], tmp_path: Path) -> None:
    markup = "<script>alert(1)</script>"

    def infect(text: str) -> str:
        choices = json.loads(text)
        return json.dumps([dict.fromkeys(choice, markup) for choice in choices])

    changed_text(sources["result"], tmp_path / "r.h5", "entry/choices", infect)
    write_report(tmp_path / "r.html", read_result(tmp_path / "r.h5"), markup)
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "alert(1)" in page
    assert markup not in page


@pytest.mark.parametrize(
    ("name", "text", "where", "what"),
    [
        ("summary", "[" * 5000, "", "nested deeper than 32 times"),
        ("summary", "{", "", "damaged"),
        ("summary", "[]", "/entry/summary", "is []; must be values by name"),
        ("summary", "{}", "/entry/summary.n_views", "is missing"),
        ("choices", '[{"effect": 1}]', "/entry/choices[0].effect", "is 1; must be a text"),
        ("stages", '[{"name": "a", "seconds": "1", "peak_mb": 1}]', "/entry/stages[0].seconds", "must be a number"),
    ],
)
def test_a_report_is_not_made_of_what_does_not_say_what_it_shows(
    sources: dict[str, Path], tmp_path: Path, name: str, text: str, where: str, what: str
) -> None:
    changed_text(sources["result"], tmp_path / "r.h5", f"entry/{name}", lambda _: text)
    with pytest.raises(InvalidInputError) as caught:
        write_report(tmp_path / "r.html", read_result(tmp_path / "r.h5"), "title")
    assert [p for p in caught.value.problems if p.where.endswith(where) and what in p.what], str(caught.value)
    assert not (tmp_path / "r.html").exists()


@pytest.mark.parametrize("text", ["[" * 5000, "[1]", "{"])
def test_figures_of_a_calibration_that_are_none_are_refused(
    sources: dict[str, Path], tmp_path: Path, text: str
) -> None:
    shutil.copy(sources["stack"], tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        file["entry"].attrs["calibration"] = text
    assert "/entry@calibration" in {problem.where for problem in refusal("stack", tmp_path / "s.h5")}


@pytest.mark.parametrize("parameters", [(np.nan, 0.0), (np.inf, 1.0), (0.0, 0.0), (-1.0, 1e-9)])
def test_an_atom_that_has_no_value_is_named(
    sources: dict[str, Path], tmp_path: Path, parameters: tuple[float, float]
) -> None:
    shutil.copy(sources["result"], tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        models = file["/entry/brdf/atom_model"].asstr()[...].tolist()
        index = models.index("lobe")
        file["/entry/brdf/atom_parameters"][index] = parameters
    (problem,) = refusal("result", tmp_path / "r.h5")
    assert problem.what.startswith(f"atom {index} is 'lobe' with ")
