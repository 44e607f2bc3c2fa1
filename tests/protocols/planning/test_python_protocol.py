from pathlib import Path

import pytest

from instrument.files.validation import InvalidInputError
from protocols.planning.plan import Plan
from protocols.planning.python_protocol import load_any_protocol
from protocols.poses.patterns import repeated, ring

ROOT = Path(__file__).parents[3]
GOOD = """
name = "two"
bracket = {"exposure_times_s": [0.01, 0.1], "darks": 0}

def poses():
    for tilt in (10, 20.0):
        yield {"tilt": tilt, "turn": 0.0}
"""


def load(path: Path, text: str) -> Plan:
    path.write_text(text)
    return Plan.from_protocol(load_any_protocol(path))


def test_a_generator_of_poses_is_frozen_into_a_plan_that_keeps_the_text(tmp_path: Path) -> None:
    plan = load(tmp_path / "p.py", GOOD)
    assert plan.positions == ((10.0, 0.0), (20.0, 0.0))
    assert load_any_protocol(tmp_path / "p.py").text == GOOD


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('name = "two"', "", "p.py: states no name; see examples/spiral.py"),
        ("def poses", "def places", "p.py: states no poses"),
        ("(10, 20.0)", "(10, 1 / 0)", "p.py:6: ZeroDivisionError"),
        ("yield", "yeild", "p.py:7: SyntaxError"),
        ("[0.01, 0.1]", "[0.1, 0.01]", "times must ascend"),
        ('"turn": 0.0', '"turn": "north"', 'poses[0].axes.turn is "north"; it must be a number'),
        ("for tilt in", "import no_such_module\n    for tilt in", "p.py:6: ModuleNotFoundError"),
    ],
)
def test_what_is_wrong_with_a_file_is_named_with_its_line(tmp_path: Path, old: str, new: str, expected: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        load(tmp_path / "p.py", GOOD.replace(old, new))
    assert expected in str(caught.value)


def test_generators_make_the_same_poses_as_the_tables_of_toml(tmp_path: Path) -> None:
    toml = 'name = "two"\n[bracket]\nexposure_times_s = [0.01]\ndarks = 0\n[[rings]]\ntilt_deg = 20.0\ncount = 3\n'
    (tmp_path / "p.toml").write_text(f"{toml}start_deg = 300.0\n[watch]\nrepeats = 2\n")
    of_toml = Plan.from_protocol(load_any_protocol(tmp_path / "p.toml"))
    python = (
        'from protocols.poses import repeated, ring\nname = "two"\nbracket = {"exposure_times_s": [0.01], "darks": 0}\n'
    )
    of_python = load(tmp_path / "p.py", f"{python}def poses():\n    return repeated(ring(20.0, 3, 300.0), 2)\n")
    assert of_toml.sha256 == of_python.sha256
    assert list(repeated(ring(20.0, 3, 300.0), 1))[1]["turn"] == 60.0


def test_the_example_spreads_its_poses_over_a_cap() -> None:
    plan = Plan.from_protocol(load_any_protocol(ROOT / "examples" / "spiral.py"))
    assert plan.n_poses == 40
    assert max(plan.targets["tilt"]) < 50.0
