"""What kind of material each of the 100 of the MERL database is."""

from __future__ import annotations

from functools import cache
from importlib.resources import files


@cache
def categories() -> dict[str, str]:
    """Return the category of each of the 100 materials by its name, as their names tell it."""
    text = (files("analysis.reflectance") / "data" / "merl_categories.csv").read_text(encoding="utf-8")
    rows = [line.split(",") for line in text.splitlines() if line and not line.startswith("#")]
    return dict(rows[1:])
