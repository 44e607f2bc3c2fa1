"""The drivers that a rig file names, and the tables that are theirs."""

import re
import tomllib
from pathlib import Path

import pytest

from drivers.device_settings import settings_from_table
from drivers.registry import KINDS, known_drivers, settings_of
from instrument.config.loading import load_rig
from instrument.files.validation import InvalidInputError
from tests.drivers.real_rigs import GRBL, SCPI, SERIAL, rig_text

ROOT = Path(__file__).parents[3]
PAGES = "\n".join((ROOT / "docs" / name).read_text() for name in ("devices.md", "light-drivers.md"))
EXAMPLES = [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", PAGES, re.DOTALL)]
REAL = [(kind, name) for kind in KINDS for name in known_drivers(kind)[1:]]


def problems_of(folder: Path, text: str) -> list[str]:
    path = folder / "rig.toml"
    path.write_text(text)
    with pytest.raises(InvalidInputError) as caught:
        load_rig(path)
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize("light", [SCPI, SERIAL])
def test_a_rig_of_real_devices_is_valid(tmp_path: Path, light: str) -> None:
    (tmp_path / "rig.toml").write_text(rig_text(light=light))
    assert load_rig(tmp_path / "rig.toml").stage.device["port"] == "/dev/ttyACM0"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("max_current_a = 1.0", "", "the key 'max_current_a' is missing in [light.device]; add it (max_current_a: "),
        ("max_current_a = 1.0", "max_current_a = 1\nmodell = 2", "unknown key 'modell' in [light.device]; did"),
        ("max_current_a = 1.0", "max_current_a = 11", "light.device.max_current_a is 11; it must be less than"),
        ("max_current_a = 1.0", "max_current_a = true", "light.device.max_current_a is true; it must be a number"),
        ("max_current_a = 1.0", "max_current_a = 1\nterminal = 3", "light.device.terminal is 3; allowed: 1 or 2"),
        ("[light.device]\nmax_current_a = 1.0", "", "the key 'max_current_a' is missing in [light.device]"),
        ('port = "/dev/ttyACM0"', "port = 3", 'stage.device.port is 3; it must be a text in "quotes"'),
        ('port = "/dev/ttyACM0"', "", "the key 'port' is missing in [stage.device]"),
        ('letter = "Y"', 'letter = "Q"', "stage.device.axes[0].letter is \"Q\"; allowed: 'X', 'Y'"),
        ("[1.0, 0.0, 0.0]\nsoft", "[1.0, 1.0, 0.0]\nsoft", "axes[0]: vector has length 1.41421; it must be 1"),
        ("[-65.0, 65.0]", "[5.0, 1.0]", "axes[0]: soft_limits are 5 to 1; the first must be"),
        ("tolerance = 0.02", "tolerance = 0.0", "axes[0].tolerance is 0.0; it must be greater than 0"),
        ("tolerance = 0.02", "tolerance = 1\nscale = 0.0", "scale is 0; state the device's units"),
        ("tolerance = 0.02", "tolerance = 1\nspeed = 3", "unknown key 'speed' in [stage.device.axes[0]]"),
        ('driver = "grbl"', 'driver = "gbrl"', "stage.driver is 'gbrl'; known drivers of a stage: simulated, "),
        ('driver = "grbl"', 'driver = "gbrl"', "Did you mean 'grbl'?"),
        ('driver = "grbl"', "driver = 7", 'stage.driver is 7; it must be a text in "quotes"'),
        ("name = \"real", "# name = \"real", "the key 'name' is missing; add it"),
    ],
)  # fmt: skip
def test_a_wrong_table_of_a_driver_is_one_problem_with_its_key(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    (problem,) = problems_of(tmp_path, rig_text().replace(old, new, 1))
    assert message in problem


@pytest.mark.parametrize(
    ("added", "message"),
    [
        ('identity = ""', "light.device.identity is \"\"; it must have at least 1 character"),
        ('level_command = "L{}"', "level_command is 'L{}', which is no format"),
        ('on_command = "an\\n"', "on_command is 'an\\n'; allowed are printable ASCII"),
        ('level_command = "L"', "it says {level} nowhere"),
        ('state = "("', "state is '(', which is no regular expression"),
        ('state = "(?P<lit>1)"', "it has no group 'level'"),
        ("full_level = 0.0", "light.device.full_level is 0.0; it must be greater than 0"),
    ],
)  # fmt: skip
def test_words_that_mean_nothing_to_a_serial_light_are_refused(tmp_path: Path, added: str, message: str) -> None:
    key = added.partition(" ")[0]
    light = "\n".join(line for line in SERIAL.splitlines() if not line.startswith(f"{key} ")) + f"\n{added}\n"
    (problem,) = problems_of(tmp_path, rig_text(light=light))
    assert message in problem


def test_all_that_is_wrong_is_said_at_once_each_at_its_line(tmp_path: Path) -> None:
    text = rig_text().replace("max_current_a = 1.0", "max_current_a = 99").replace('letter = "Y"', 'letter = "Q"')
    text = text.replace('driver = "genicam"', 'driver = "genie"')
    lines = [f"rig.toml:{i}" for i, line in enumerate(text.splitlines(), 1) if re.search('99|"Q"|genie', line)]
    assert [problem.split(": ")[0] for problem in problems_of(tmp_path, text)] == lines


def test_two_axes_do_not_share_a_name_or_a_letter(tmp_path: Path) -> None:
    axes = GRBL.partition("[[")[2]
    (problem,) = problems_of(tmp_path, rig_text(stage=f"{GRBL}\n[[{axes}"))
    assert "the name of two axes is tilt; the letter of two axes is Y" in problem


def test_simulated_and_real_devices_are_not_mixed(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, rig_text(stage='[stage]\ndriver = "simulated"'))
    assert "the rig mixes simulated (stage) and real devices (camera = 'genicam', light = 'scpi')" in problem


def test_a_real_rig_has_no_simulation(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, rig_text() + "\n[simulation]\nseed = 1\n")
    assert "the table [simulation] is for simulated devices, and these are real; remove it" in problem


def test_a_simulated_device_has_no_table_of_its_own(tmp_path: Path) -> None:
    text = (ROOT / "examples" / "simulated.toml").read_text()
    (problem,) = problems_of(tmp_path, text.replace("[light]", '[camera.device]\nport = "x"\n\n[light]'))
    assert "unknown key 'port' in [camera.device]" in problem


def test_every_table_of_the_manual_is_understood() -> None:
    kinds = []
    for tables in EXAMPLES:
        ((kind, table),) = tables.items()
        names = [table["driver"]] if "driver" in table else ["serial"]
        for name in names:
            settings_from_table(settings_of(kind, name), table["device"])
            kinds.append((kind, name))
    assert set(kinds) == set(REAL)


@pytest.mark.parametrize(("kind", "name"), REAL)
def test_the_manual_names_every_key_of_every_driver(kind, name) -> None:
    keys = settings_of(kind, name).model_fields
    assert [key for key in keys if not re.search(rf"\b{key}\b", PAGES)] == []
    assert [key for key, field in keys.items() if not field.description] == []
