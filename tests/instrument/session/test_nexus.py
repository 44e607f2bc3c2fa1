"""The viewers of NeXus open a session on its overview."""

from pathlib import Path

import h5py
import numpy as np
import silx.io
from silx.io.nxdata import NXdata, get_default

from instrument.session import layout
from instrument.session.session import Session
from instrument.session.structure import axis_names


def test_silx_opens_a_session_on_the_overview(session_path: Path) -> None:
    with silx.io.open(str(session_path)) as file:
        plot = get_default(file)
        assert plot is not None
        assert plot.is_valid
        assert not plot.issues
        assert plot.group.name == layout.OVERVIEW
        assert plot.signal_dataset_name == "preview"
        assert plot.signal.shape == (3, 8, 12)
        assert plot.interpretation == "image"
        assert plot.axes_dataset_names == ["pose", None, None]
        assert plot.plot_style.signal_scale_type == "log"
        assert np.isfinite(plot.signal[()]).all()


def test_silx_finds_the_other_plots_valid_too(session_path: Path) -> None:
    with silx.io.open(str(session_path)) as file:
        raw, quality = NXdata(file[layout.RAW]), NXdata(file[layout.QUALITY])
        assert raw.is_valid
        assert raw.axes_dataset_names == ["pose", "count_time", None, None]
        assert raw.signal.shape == (3, 2, 16, 24)
        assert quality.is_valid
        assert [signal.name.rpartition("/")[2] for signal in quality.auxiliary_signals] == ["black_fraction"]


def test_the_raw_plot_shares_the_frames_and_copies_nothing(session_path: Path) -> None:
    with h5py.File(session_path) as file:
        assert file[f"{layout.RAW}/images"] == file[layout.IMAGES.path]
        assert isinstance(file.get(f"{layout.RAW}/images", getlink=True), h5py.HardLink)


def test_every_group_says_its_class(session_path: Path) -> None:
    missing = []

    def collect(name: str, item: h5py.HLObject) -> None:
        if isinstance(item, h5py.Group) and "NX_class" not in item.attrs:
            missing.append(name)

    with h5py.File(session_path) as file:
        file.visititems(collect)
        assert missing == []
        assert file.attrs["default"] == "entry"
        assert file["entry"].attrs["default"] == "overview"


def test_the_axes_are_a_chain_of_transformations_from_the_sample_to_the_base(session_path: Path) -> None:
    with h5py.File(session_path) as file:
        chain, path = [], file[f"{layout.SAMPLE}/depends_on"].asstr()[()]
        while path != ".":
            chain.append((path.rpartition("/")[2], file[path].attrs["transformation_type"]))
            assert file[path].attrs["units"] == "deg"
            path = file[path].attrs["depends_on"]
        assert chain == [("turn", "rotation"), ("tilt", "rotation")]
        assert axis_names(file) == ["tilt", "turn"]


def test_the_preview_is_the_longest_exposure_that_is_not_clipped(session_path: Path) -> None:
    with Session(session_path) as session, h5py.File(session_path, locking=False) as file:
        clipped = session.saturated_fraction[0]
        assert clipped[0] == 0
        assert clipped[1] > 1e-3
        blocks = session.frames(0)[0].reshape(8, 2, 12, 2).mean(axis=(1, 3))
        np.testing.assert_allclose(file[layout.PREVIEW.path][0], (blocks - 64) / 0.01, rtol=1e-5)
        np.testing.assert_array_equal(session.preview(0), file[layout.PREVIEW.path][0])
