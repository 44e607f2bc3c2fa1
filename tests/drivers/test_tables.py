"""Tables of the rig file as the drivers read them."""

import re
import tomllib

import pytest

from drivers.scpi_light.settings import ScpiLightSettings
from drivers.serial_light.settings import SerialLightSettings
from drivers.tables import settings_from_table
from tests.drivers.test_supervised_light import ROOT

EXAMPLES = re.findall(r"```toml\n(.*?)```", (ROOT / "docs/light-drivers.md").read_text(), re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_of_the_manual_is_understood(example: str) -> None:
    table = tomllib.loads(example)["light"]["device"]
    kind = SerialLightSettings if "port" in table else ScpiLightSettings
    settings = settings_from_table(kind, table, "[light.device]")
    assert {key: getattr(settings, key) for key in table} == table


def test_a_whole_number_may_stand_for_a_float() -> None:
    assert settings_from_table(ScpiLightSettings, {"max_current": 1}, "[light.device]").max_current == 1.0


def test_the_manual_names_every_key() -> None:
    manual = (ROOT / "docs/light-drivers.md").read_text()
    for kind in (ScpiLightSettings, SerialLightSettings):
        assert [key for key in kind.__dataclass_fields__ if not re.search(rf"\b{key}\b", manual)] == []
