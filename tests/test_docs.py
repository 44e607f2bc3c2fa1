"""What the documentation says can be typed, and what it points at is there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import get_args

import click
import pytest
from pydantic import BaseModel

from cli.main import halfangle
from instrument.config.capture_config import CaptureConfig, load_capture
from instrument.config.faults import load_faults
from instrument.config.loading import load_rig
from protocols.planning.python_protocol import load_any_protocol

ROOT = Path(__file__).parent.parent
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "examples" / "driver_package" / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
COMMAND_LINES = sorted(
    {
        line.strip()
        for page in PAGES
        for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
        for line in block.splitlines()
        if line.startswith("halfangle ")
    }
)


def test_the_documentation_shows_commands() -> None:
    assert len(COMMAND_LINES) >= 10


@pytest.mark.parametrize("line", COMMAND_LINES)
def test_every_command_in_the_documentation_can_be_parsed(line: str) -> None:
    arguments = shlex.split(line, comments=True)[1:]
    group: click.Command = halfangle
    context = click.Context(halfangle)
    while isinstance(group, click.Group):
        name, command, arguments = group.resolve_command(context, arguments)
        assert command is not None
        context, group = click.Context(command, info_name=name, parent=context), command
    # Parses and checks every option; runs nothing.
    group.make_context(group.name, arguments)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert missing == []


def test_the_examples_are_valid() -> None:
    for name in ("simulated.toml", "real_rig.toml"):
        assert load_rig(ROOT / "examples" / name).name
    others = {"simulated.toml", "real_rig.toml", "faults.toml"}
    protocols = [path for path in (ROOT / "examples").glob("*.*") if path.name not in others]
    assert len(protocols) >= 8
    for protocol in protocols:
        assert load_any_protocol(protocol).name
    assert load_faults(ROOT / "examples" / "faults.toml")


CAPTURE_EXAMPLES = re.findall(
    r"```toml\n(.*?)```", (ROOT / "docs" / "import.md").read_text(encoding="utf-8"), re.DOTALL
)


@pytest.mark.parametrize("text", CAPTURE_EXAMPLES, ids=lambda text: text.splitlines()[0])
def test_every_capture_file_in_the_documentation_is_valid(text: str, tmp_path: Path) -> None:
    (tmp_path / "capture.toml").write_text(text, encoding="utf-8")
    assert load_capture(tmp_path / "capture.toml").name


def capture_keys(model: type[BaseModel]) -> set[str]:
    """Return every key and table that a capture.toml may have, at any depth."""
    keys = set(model.model_fields)
    for field in model.model_fields.values():
        for kind in (field.annotation, *get_args(field.annotation)):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                keys |= capture_keys(kind)
    return keys


def test_the_page_of_import_explains_every_key_and_no_other() -> None:
    rows = re.findall(r"^\| ([^|]*) \|", (ROOT / "docs" / "import.md").read_text(encoding="utf-8"), re.MULTILINE)
    explained = {key for row in rows for key in re.findall(r"`\[*([a-z_]+)\]*`", row)}
    in_a_value = {"files", "times_s", "distance_mm"}
    assert capture_keys(CaptureConfig) - in_a_value == explained - in_a_value
