import pytest

from instrument.config.toml_lines import KeyPath, TomlLines, parse_toml
from instrument.files.validation import InvalidInputError

TEXT = '''# a comment
name = "x" # [not a table]

[camera]
lens.focal = 1
times = [
  1,  # ]
  2]
note = """
[no table]
"""
[[boards]]
id = 1
[boards.place]
x = 3

[[boards]]
id = {v = 2}
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("name",), 2),
        (("camera",), 4),
        (("camera", "lens", "focal"), 5),
        (("camera", "times", 1), 6),
        (("camera", "note"), 9),
        (("boards", 0), 12),
        (("boards", 0, "id"), 13),
        (("boards", 0, "place", "x"), 15),
        (("boards", 1, "id", "v"), 18),
        (("camera", "missing"), 4),
        (("boards", 1, "missing"), 17),
        (("missing",), 1),
    ],
)
def test_a_key_is_found_on_its_line_and_a_missing_one_at_its_table(path: KeyPath, line: int) -> None:
    assert TomlLines(TEXT).line(path) == line


@pytest.mark.parametrize(
    ("text", "line"),
    [("a = 1\nb = \n", 2), ("a = 1\na = 2\n", 2), ('a = "x\n', 1), ("a = 1\n[b\nc = 2", 2), ("\n\na = [1,", 3)],
)
def test_a_syntax_error_is_placed_on_its_line(text: str, line: int) -> None:
    with pytest.raises(InvalidInputError) as caught:
        parse_toml(text, "rig.toml")
    assert caught.value.problems[0].where == f"rig.toml:{line}"
