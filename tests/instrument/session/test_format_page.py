from pathlib import Path

from instrument.session import layout

PAGE = (Path(__file__).parents[3] / "docs" / "format.md").read_text()


def test_the_format_page_names_every_dataset_of_a_session() -> None:
    fields = [*layout.FIELDS, *layout.AXIS_FIELDS, *layout.BOARD_FIELDS]
    assert [field.path for field in fields if f"{field.name}`" not in PAGE and f"/{field.name}" not in PAGE] == []


def test_the_format_page_describes_the_version_that_is_written() -> None:
    assert f"this page describes **{layout.SCHEMA_VERSION}**" in PAGE


def test_the_format_page_states_the_units_of_every_dataset() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith("| `")]
    for field in layout.FIELDS:
        row = next((row for row in rows if f"{field.name}`" in row.split("|")[1]), None)
        if row and field.units:
            assert field.units in row, field.path
