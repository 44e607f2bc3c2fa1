"""What `halfangle rig check` finds out."""

import re
from typing import Any

import numpy as np
import pytest

from drivers.errors import DeviceError
from drivers.light import LightState
from drivers.limits import Limits
from drivers.readback import Setting, confirm
from instrument.rig.check import Finding, check_rig
from instrument.rig.lock import RigBusyError, hold
from tests.protocols.fakes import BLACK, HEIGHT, WIDTH, FakeBench, FakeCamera, FakeLight, FakeStage, rig_config


def checked(bench: FakeBench, **options: Any) -> list[Finding]:
    return list(check_rig(rig_config(), bench.devices, **options))


def failures(findings: list[Finding]) -> list[tuple[str, str]]:
    return [(finding.kind, finding.text) for finding in findings if finding.verdict == "FAIL"]


def test_a_rig_that_works_passes_and_is_left_dark_stopped_and_disconnected() -> None:
    bench = FakeBench()
    findings = checked(bench)
    assert {finding.verdict for finding in findings} == {"PASS"}
    assert {finding.kind for finding in findings} == {"camera", "light", "stage"}
    assert not bench.lit
    assert bench.position == {"tilt": 0.0, "turn": 0.0}
    assert bench.calls[-6:] == [
        "light.off", "stage.stop", "camera.stop",
        "camera.disconnect", "stage.disconnect", "light.disconnect",
    ]  # fmt: skip


def test_the_stage_finds_its_zero_only_when_asked() -> None:
    asked, unasked = FakeBench(), FakeBench()
    checked(asked, home=True)
    checked(unasked)
    assert "stage.home" in asked.calls
    assert "stage.home" not in unasked.calls


@pytest.mark.parametrize("kind", ["light", "stage", "camera"])
def test_a_device_that_fails_keeps_no_other_from_being_looked_at(kind: str) -> None:
    def script(_: int, name: str) -> None:
        if name == f"{kind}.connect":
            raise DeviceError(f"no {kind} there")

    findings = checked(FakeBench(script))
    assert failures(findings) == [(kind, f"no {kind} there")]
    others = {"camera", "light", "stage"} - {kind}
    assert {finding.kind for finding in findings if finding.verdict == "PASS"} >= others


def test_a_light_that_stays_dark_and_one_that_stays_lit_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    dark, lit = (LightState(state, 0.1, float("nan"), float("nan")) for state in (False, True))
    monkeypatch.setattr(FakeLight, "on", lambda *_: dark)
    assert failures(checked(FakeBench()))[0][1].startswith("it was told to shine at level 0.1 and reads back dark")
    monkeypatch.undo()
    monkeypatch.setattr(FakeLight, "off", lambda _: lit)
    bench = FakeBench()
    found = failures(checked(bench))
    assert found[0] == ("light", "it may shine. Switch it off by hand; nothing else was tried")
    assert "switch it off by hand" in found[1][1]
    assert "stage.move" not in bench.calls


def test_an_axis_that_does_not_come_back_fails_with_how_far_it_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeStage, "move", lambda _, target: {name: value + 0.5 for name, value in target.items()})
    found = failures(checked(FakeBench()))
    assert [kind for kind, _ in found] == ["stage", "stage"]
    assert "axis tilt at 0 moved by 1 deg and back, 0.5 deg off" in found[0][1]


def test_a_camera_that_sees_no_light_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = FakeCamera.trigger

    def capped(camera: FakeCamera) -> Any:
        frame = taken(camera)
        return type(frame)(np.full_like(frame.counts, 64), frame.sequence_number, frame.exposure_time, 20.0)

    monkeypatch.setattr(FakeCamera, "trigger", capped)
    (warning,) = [finding for finding in checked(FakeBench()) if finding.verdict == "WARN"]
    assert "sees no light when it shines" in warning.text
    assert "lens cap" in warning.text


def test_a_camera_of_another_size_than_the_rig_file_says_fails() -> None:
    config = rig_config()
    wide = config.model_copy(update={"camera": config.camera.model_copy(update={"width": 4096})})
    ((kind, text),) = failures(list(check_rig(wide, FakeBench().devices)))
    assert (kind, text) == ("camera", f"delivers 24 x 16 pixels; [camera] says 4096 x {config.camera.height}")


def test_a_device_that_was_swapped_fails_before_it_does_anything() -> None:
    config = rig_config()
    named = config.model_copy(update={"light": config.light.model_copy(update={"serial_number": "M7"})})
    bench = FakeBench()
    ((kind, text),) = failures(list(check_rig(named, bench.devices)))
    assert (kind, text) == ("light", "its serial number is 'one'; [light] asks for 'M7'")
    assert "light.on" not in bench.calls


def test_a_rig_in_use_is_left_alone() -> None:
    with hold(rig_config().name), pytest.raises(RigBusyError):
        checked(FakeBench())


def test_a_setting_tells_its_value_unit_and_range() -> None:
    assert str(Setting("gain", 3.0, "dB", Limits(0.0, 24.0, "dB"))) == "gain 3 dB (0 to 24)"
    assert str(Setting("pixel format", "Mono12", choices=("Mono8", "Mono12"))) == "pixel format Mono12"


@pytest.mark.parametrize("read_back", [3.2, float("nan")])
def test_a_value_that_is_not_kept_is_an_error_with_both(read_back: float) -> None:
    confirm("gain", 3.0, 3.05, 0.1, "dB")
    with pytest.raises(DeviceError, match=r"gain was set to 3 dB and reads back (3\.2|nan) dB"):
        confirm("gain", 3.0, read_back, 0.1, "dB")


class PlateCamera(FakeCamera):
    """Sees a plate, through a curve."""

    power, dead_time = 1.0, 0.0

    def counts(self) -> np.ndarray:
        rng = np.random.default_rng(self.n_triggers)
        light = 2.0e5 * max(self.exposure_time + self.dead_time, 0.0) * self.bench.lit
        signal = 4000.0 * (light / 4000.0) ** self.power
        return np.clip(rng.normal(BLACK + signal, np.sqrt(1.0 + signal), (HEIGHT, WIDTH)), 0, 4095).astype(np.uint16)


def linearity_of(monkeypatch: pytest.MonkeyPatch, **curve: Any) -> Finding:
    camera = type("Camera", (PlateCamera,), curve)
    bench = FakeBench()
    monkeypatch.setattr(bench, "devices", lambda _: (camera(bench), FakeLight(bench), FakeStage(bench)))
    *_, last = checked(bench, linearity=True)
    assert not bench.lit
    return last


def test_a_camera_whose_counts_are_proportional_to_light_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    found = linearity_of(monkeypatch)
    assert found.verdict == "PASS"
    assert "proportional to the exposure time within" in found.text


def test_a_gamma_that_nobody_switched_off_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    assert linearity_of(monkeypatch, power=0.95).verdict == "FAIL"


def test_a_shutter_that_is_open_longer_than_it_says_fails_with_by_how_much(monkeypatch: pytest.MonkeyPatch) -> None:
    found = linearity_of(monkeypatch, dead_time=2e-4)
    assert found.verdict == "FAIL"
    offset = re.search(r"times that are (\d+) us longer than stated", found.text)
    assert offset is not None
    assert 150 < int(offset[1]) < 250


def test_without_a_plate_that_can_be_seen_it_is_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    found = linearity_of(monkeypatch, counts=lambda _: np.full((HEIGHT, WIDTH), int(BLACK), np.uint16))
    assert found.verdict == "FAIL"
    assert "Look at the plate, the light's level and the lens cap" in found.text
