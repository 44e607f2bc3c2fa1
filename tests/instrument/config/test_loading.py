import re
from dataclasses import fields
from pathlib import Path

import cv2
import pytest

from drivers.simulated.settings import SimulationSettings
from instrument.config.boards import DICTIONARY_SIZES, BoardConfig
from instrument.config.loading import load_protocol, load_rig
from instrument.config.messages import validate
from instrument.config.rig import SimulationConfig
from instrument.files.validation import InvalidInputError

EXAMPLES = Path(__file__).parents[3] / "examples"
RIG = (EXAMPLES / "simulated.toml").read_text()
PROTOCOL = (EXAMPLES / "hdr_sweep.toml").read_text()


def line_of(text: str, start: str) -> int:
    return next(i for i, line in enumerate(text.splitlines(), 1) if line.startswith(start))


def problems_of(path: Path) -> list[str]:
    with pytest.raises(InvalidInputError) as caught:
        (load_rig if path.name == "rig.toml" else load_protocol)(path)
    return [str(problem) for problem in caught.value.problems]


def test_the_examples_are_valid() -> None:
    rig, protocol = load_rig(EXAMPLES / "simulated.toml"), load_protocol(EXAMPLES / "hdr_sweep.toml")
    assert rig.model_dump()["camera"]["width"] == 960
    assert rig.text == RIG
    assert len(rig.boards) == 4
    assert [ring.count for ring in protocol.rings] == [1, 8, 12, 14, 14, 16]


@pytest.mark.parametrize(
    ("old", "new", "line", "expected"),
    [
        ("[stage]", "[stage]\nspeeed = 1", "speeed", "unknown key 'speeed' in [stage]. Known keys: driver"),
        ("width = 960", "width = 961", "width", "camera.width is 961; it must be a multiple of 2"),
        ("width = 960", 'width = "960"', "width", 'camera.width is "960"; it must be a whole number'),
        ("width = 960", "width = 9.5", "width", "camera.width is 9.5; it must be a whole number"),
        ("width = 960", "width = true", "width", "camera.width is true; it must be a whole number"),
        ("= 1850.0", "= nan", "focal", "focal_length_px is NaN; it must be a finite number"),
        ("= 1850.0", "= -1", "focal", "focal_length_px is -1; it must be greater than 0"),
        ('name = "simulated bench"', "", "[camera]", None),
        ("level = 1.0", "level = 1.5", "level", "light.level is 1.5; it must be less than or equal to 1"),
        ("[12.0, 0.0, 0.0]", "[12.0, 0.0]", "offset_mm", "light.offset_mm has 2 elements, too few"),
        ("[12.0, 0.0, 0.0]", "[1, 2, 3, 4]", "offset_mm", "it must have at most 3 items"),
        ("[12.0, 0.0, 0.0]", '[1, 2, "x"]', "offset_mm", 'light.offset_mm[2] is "x"; it must be a number'),
        ("[12.0, 0.0, 0.0]", "12.0", "offset_mm", "light.offset_mm is 12.0; it must be a list"),
        ("[60.0, 60.0]", "[60.0, 0.0]", "area_mm", "geometry.area_mm[1] is 0.0; it must be greater than 0"),
        ('"relief"', '"releif"', "scene", "allowed: 'relief', 'plane' or 'sphere_cap'; did you mean 'relief'?"),
        ("seed = 7", "seed = 1979-05-27", "seed", "simulation.seed is"),
    ],
)
def test_one_wrong_value_gives_one_problem_with_line_key_and_what_is_allowed(
    tmp_path: Path, old: str, new: str, line: str, expected: str | None
) -> None:
    text = RIG.replace(old, new, 1)
    (tmp_path / "rig.toml").write_text(text)
    problems = problems_of(tmp_path / "rig.toml")
    assert len(problems) == 1
    if expected is None:
        assert "the key 'name' is missing; add it (name: what the rig is called)" in problems[0]
    else:
        assert problems[0].startswith(f"rig.toml:{line_of(text, line)}: ")
        assert expected in problems[0]


@pytest.mark.parametrize(
    ("board", "old", "new", "key", "expected"),
    [
        (1, '"DICT_4X4_50"', '"DICT_4X4_51"', "dictionary", "known dictionaries: DICT_4X4_50, DICT_4X4_100"),
        (1, "= 4.4", "= 5.5", "[[boards]]", "marker_mm is 5.5; it must be less than square_mm (5.5)"),
        (1, "= 8", "= 46", "[[boards]]", "needs ids up to 53, and DICT_4X4_50 ends at 49"),
        (1, "= 8", "= 3", "first_id", "overlap those of boards[0] (0 to 7); the next free id after that board is 8"),
        (1, "[32.0, 54.0]", "[20.0, 34.0]", "corner_mm", "which overlaps geometry.area_mm; move it outside"),
        (1, "[32.0, 54.0]", "[-40.0, 60.0]", "corner_mm", "which overlaps boards[0]"),
        (3, "[4, 4]", "[4, 1]", "squares", "boards[3].squares[1] is 1; it must be greater than or equal to 2"),
        (2, '"charuco"', '"checker"', "kind", "boards[2].kind is \"checker\"; allowed: 'charuco' or 'checkerboard'"),
        (2, '"charuco"', '"checkerboard"', "[[boards]]", "leave out dictionary, first_id, marker_mm, or is its kind"),
        (2, "first_id = 16", "", "[[boards]]", "a charuco board has markers; add first_id"),
        (2, "= 4.4", "= 0", "[[boards]]", "marker_mm is 0; it must be greater than 0"),
        (1, "[32.0, 54.0]", '"measure"', "corner_mm", "the simulated rig needs the place in numbers"),
        (
            1,
            "[32.0, 54.0]",
            '"guess"',
            "corner_mm",
            "it must be a list in [brackets] (corner_mm: x and y of the top left",
        ),
    ],
)
def test_a_wrong_board_is_found_at_its_own_line(
    tmp_path: Path, board: int, old: str, new: str, key: str, expected: str
) -> None:
    parts = RIG.split("[[boards]]")
    parts[board + 1] = parts[board + 1].replace(old, new, 1)
    text = "[[boards]]".join(parts)
    (tmp_path / "rig.toml").write_text(text)
    first = "[[boards]]".join(parts[: board + 1]).count("\n")
    offset = 0 if key == "[[boards]]" else line_of(parts[board + 1], key) - 1
    (problem,) = problems_of(tmp_path / "rig.toml")
    assert problem.startswith(f"rig.toml:{first + 1 + offset}: ")
    assert expected in problem


def test_a_checkerboard_needs_no_markers_and_may_lie_anywhere() -> None:
    table = {"kind": "checkerboard", "squares": [10, 7], "square_mm": 25.0, "corner_mm": "measure"}
    board = validate(BoardConfig, table)
    assert board.corner_mm is board.rectangle is None
    assert len(board.marker_ids) == 0
    assert not board.record.is_placed
    placed = validate(BoardConfig, {**table, "corner_mm": [-125, 87.5]})
    assert placed.rectangle == (-125, -87.5, 125, 87.5)
    assert placed.record.corner_mm == (-125, 87.5)
    # What a session keeps of a rig's boards reads back.
    assert BoardConfig.model_validate_json(board.model_dump_json(), strict=True) == board


def test_every_problem_is_found_at_once_though_tables_are_broken(tmp_path: Path) -> None:
    text = (
        RIG.replace("width = 960", "widht = 960")
        .replace("first_id = 8", "first_id = 3")
        .replace("[stage]", "[stages]")
        .replace("offset_sigma_mm = 3.0", "offset_sigma_mm = 0")
    )
    (tmp_path / "rig.toml").write_text(text)
    found = "\n".join(problems_of(tmp_path / "rig.toml"))
    for fragment in (
        "unknown key 'widht'",
        "the key 'width' is missing in [camera]",
        "unknown key 'stages'; did you mean 'stage'?",
        "the table [stage] is missing",
        "light.offset_sigma_mm is 0",
        "boards[1].first_id: the board's marker ids 3 to 10 overlap",
    ):
        assert fragment in found
    lines = [int(number) for number in re.findall(r"^rig.toml:(\d+):", found, re.MULTILINE)]
    assert lines == sorted(lines)
    assert len(lines) == 6


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("0.002, 0.01, 0.05", "0.01, 0.002, 0.05", "element 1 (0.002 s) is shorter than element 0 (0.01 s)"),
        ("0.002, 0.01, 0.05", "0.01, 0.01", "element 1 (0.01 s) repeats element 0 (0.01 s)"),
        ("0.002, 0.01, 0.05", "0.0, 0.01", "bracket.exposure_times_s[0] is 0.0; it must be greater than 0"),
        ("0.002, 0.01, 0.05", "", "it must have at least 1 item"),
        ("darks = 4", "darks = 1", "use 0, or 2 and more: one dark frame has no variance"),
        ("count = 8", "count = 0", "rings[1].count is 0; it must be greater than or equal to 1"),
        ("tilt_deg = 50.0", "tilt = 50.0", "unknown key 'tilt' in [rings[5]]; did you mean 'tilt_deg'?"),
        ("[bracket]", "[brackets]", "the table [bracket] is missing"),
    ],
)
def test_a_wrong_protocol_says_what_is_allowed(tmp_path: Path, old: str, new: str, expected: str) -> None:
    (tmp_path / "protocol.toml").write_text(PROTOCOL.replace(old, new, 1))
    assert expected in "\n".join(problems_of(tmp_path / "protocol.toml"))


def test_a_protocol_without_poses_says_what_to_add(tmp_path: Path) -> None:
    (tmp_path / "protocol.toml").write_text(PROTOCOL.split("[[rings]]")[0])
    assert "add a [[rings]], a [[poses]] or a [chosen] table" in problems_of(tmp_path / "protocol.toml")[0]


def test_poses_that_place_other_axes_are_refused(tmp_path: Path) -> None:
    (tmp_path / "protocol.toml").write_text(PROTOCOL + "\n[[poses]]\naxes = { tilt = 1.0 }\n")
    (problem,) = problems_of(tmp_path / "protocol.toml")
    assert "poses[0].axes names ['tilt']; every pose must place the same axes" in problem


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"name = \n", "rig.toml:1: "),
        (b"a = 1\nb = \xff\n", "rig.toml:2: byte 0xff is not UTF-8"),
        (b"#" * 1_000_001, "larger than 1000000 bytes"),
        (b"", "the table [camera] is missing"),
    ],
)
def test_a_file_that_is_no_configuration_is_refused(tmp_path: Path, content: bytes, expected: str) -> None:
    (tmp_path / "rig.toml").write_bytes(content)
    assert expected in "\n".join(problems_of(tmp_path / "rig.toml"))


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    assert "No such file" in problems_of(tmp_path / "rig.toml")[0]
    (tmp_path / "rig.toml").mkdir()
    assert "Is a directory" in problems_of(tmp_path / "rig.toml")[0]


def test_windows_line_ends_and_a_byte_order_mark_change_no_line_number(tmp_path: Path) -> None:
    text = RIG.replace("width = 960", "width = 0")
    (tmp_path / "rig.toml").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert problems_of(tmp_path / "rig.toml")[0].startswith(f"rig.toml:{line_of(text, 'width')}: ")


def test_the_marker_dictionaries_have_the_sizes_that_opencv_says() -> None:
    for name, size in DICTIONARY_SIZES.items():
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        assert dictionary.bytesList.shape[0] == size, name


def test_the_simulation_table_has_the_keys_and_defaults_of_the_simulator() -> None:
    expected = {field.name: field.default for field in fields(SimulationSettings)}
    found = SimulationConfig().model_dump()
    assert list(found) == list(expected)
    # Without it the simulator takes the place that [light] gives.
    assert found.pop("light_offset_mm") is None
    assert found == {name: expected[name] for name in found}
