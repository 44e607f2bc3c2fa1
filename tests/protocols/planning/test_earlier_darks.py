from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from instrument.config.loading import ProtocolConfig, load_protocol
from instrument.config.messages import validate
from instrument.files.validation import InvalidInputError
from instrument.session import layout
from instrument.session.session import Session
from protocols.capture.engine import Finish, Outcome, capture
from protocols.planning.estimate import estimate
from tests.faults.bench import FaultyBench, rig_config
from tests.verifying import verify_session

DARKS = {
    "name": "darks and flats",
    "bracket": {"exposure_times_s": [0.002, 0.01, 0.05], "darks": 3},
    "flats": {"exposure_time_s": 0.004, "count": 2},
    "poses": [{"axes": {"tilt": 0.0, "turn": 0.0}}],
}


def sweep(path: Path, times: tuple[float, ...] = (0.002, 0.05), **kept: Any) -> ProtocolConfig:
    return validate(
        ProtocolConfig,
        {
            "name": "sweep",
            "bracket": {"exposure_times_s": times},
            "rings": [{"tilt_deg": 20.0, "count": 2}],
            "darks_and_flats": {"session": str(path), **kept},
        },
    )


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("darks") / "darks.h5"
    outcome = capture(rig_config(), validate(ProtocolConfig, DARKS), path, devices=FaultyBench().devices)
    assert outcome.finish is Finish.COMPLETE
    return path


def captured(protocol: ProtocolConfig, path: Path, **rig: Any) -> Outcome:
    return capture(rig_config(**rig), protocol, path, devices=FaultyBench().devices)


def test_flats_are_taken_at_the_first_pose_and_kept(kept: Path) -> None:
    assert list(verify_session(kept)) == []
    with Session(kept) as session:
        assert session.extra.flat_times.tolist() == [0.004, 0.004]
        assert session.camera.black_level + 5 < np.median(session.extra.flat_images(0)) < 3000
        assert session.dark_temperatures is not None
        assert np.isfinite(session.dark_temperatures).all()


def test_a_session_takes_over_the_darks_of_its_exposure_times_and_the_flats(tmp_path: Path, kept: Path) -> None:
    assert captured(sweep(kept), tmp_path / "s.h5").finish is Finish.COMPLETE
    with Session(tmp_path / "s.h5") as session, Session(kept) as source:
        assert session.dark is not None
        assert source.dark is not None
        np.testing.assert_array_equal(session.dark, source.dark[[0, 2]])
        np.testing.assert_array_equal(session.extra.flat_images(1), source.extra.flat_images(1))
        assert (session.dark_timestamps < 0).all()
        assert source.digest() in session.versions["sources"].values()
    assert list(verify_session(tmp_path / "s.h5")) == []


def aged(kept: Path, path: Path, hours: float) -> Path:
    path.write_bytes(kept.read_bytes())
    with h5py.File(path, "r+") as file:
        file[layout.START_TIME.path][()] = (datetime.now(UTC) - timedelta(hours=hours)).isoformat()
    return path


def refused(protocol: ProtocolConfig, path: Path, **rig: Any) -> str:
    with pytest.raises(InvalidInputError) as caught:
        captured(protocol, path, **rig)
    assert not path.exists()
    return str(caught.value)


def test_darks_that_are_too_old_are_refused(tmp_path: Path, kept: Path) -> None:
    old = aged(kept, tmp_path / "old.h5", 30.0)
    text = refused(sweep(old), tmp_path / "s.h5")
    assert "are 30.0 h old; allowed is 24 h. Take new ones" in text
    assert captured(sweep(old, largest_age_h=48.0), tmp_path / "s.h5").finish is Finish.COMPLETE


def test_every_exposure_time_needs_its_dark_and_all_reasons_come_at_once(tmp_path: Path, kept: Path) -> None:
    old = aged(kept, tmp_path / "old.h5", 30.0)
    text = refused(sweep(old, times=(0.003, 0.05, 20.0)), tmp_path / "s.h5")
    assert "has no dark of 0.003 s; it has 0.002, 0.01, 0.05 s" in text
    assert "has no dark of 20 s" in text
    assert "the value is 20 s; allowed is 1e-05 to 10 s" in text
    assert "h old" in text


def test_darks_of_another_camera_or_of_no_session_are_refused(tmp_path: Path, kept: Path) -> None:
    other = rig_config()
    other = other.model_copy(update={"simulation": other.simulation.model_copy(update={"seed": 8})})
    with pytest.raises(InvalidInputError, match=r"is of camera 'sim-3', this is 'sim-8'"):
        capture(other, sweep(kept), tmp_path / "s.h5", devices=FaultyBench().devices)
    (tmp_path / "no.h5").write_text("no")
    assert "this is not an HDF5 file" in refused(sweep(tmp_path / "no.h5"), tmp_path / "s.h5")
    assert "there is no such file" in refused(sweep(tmp_path / "nothing.h5"), tmp_path / "s.h5")


def test_another_rig_file_than_that_of_the_darks_is_a_warning(tmp_path: Path, kept: Path) -> None:
    outlook = estimate(rig_config(level=0.5), sweep(kept), FaultyBench().devices)
    assert "the rig file was changed since" in outlook.warnings[0]
    assert f"of {kept}, 0.0 h old" in outlook.as_text()
    outcome = captured(sweep(kept), tmp_path / "s.h5", level=0.5)
    assert "the rig file was changed since" in outcome.warnings[0]


def test_a_sensor_of_another_temperature_than_at_the_darks_is_a_warning(tmp_path: Path, kept: Path) -> None:
    warm = tmp_path / "warm.h5"
    warm.write_bytes(kept.read_bytes())
    with h5py.File(warm, "r+") as file:
        file[layout.DARK_TEMPERATURE.path][...] = 12.0
    outcome = captured(sweep(warm), tmp_path / "s.h5")
    assert outcome.finish is Finish.COMPLETE
    assert "the sensor is 19.0 degrees warmer than at the darks (allowed 5)" in outcome.warnings[0]


def test_the_file_of_the_darks_is_looked_for_beside_the_protocol(tmp_path: Path) -> None:
    text = 'name = "p"\n[bracket]\nexposure_times_s = [0.1]\n[[poses]]\naxes = { x = 1.0 }\n'
    (tmp_path / "p.toml").write_text(f'{text}[darks_and_flats]\nsession = "d.h5"\n')
    kept = load_protocol(tmp_path / "p.toml").darks_and_flats
    assert kept is not None
    assert kept.session == str(tmp_path / "d.h5")
