"""The tables that docs/devices.md shows."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

_PAGE = Path(__file__).parents[2] / "docs" / "devices.md"


def toml_of_page(line: str) -> dict[str, Any]:
    """Return the one block of TOML with this line, parsed."""
    blocks = re.findall(r"^```toml\n(.*?)^```", _PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    (block,) = [block for block in blocks if line in block]
    return tomllib.loads(block)
