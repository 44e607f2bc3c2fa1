"""The plan of an import: which pictures became which frames; frozen in the session like that of a capture."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from instrument.files.digests import text_digest
from instrument.files.json_text import parse_json

KIND = "import"

PLAN_VERSION = "1.0"


@dataclass(frozen=True, slots=True)
class Source:
    """A picture that was imported.

    Attributes
    ----------
    file : str
        Its path within the folder, with slashes.
    sha256 : str
        Hex digest of the file.
    exposure_time_s : float
        As stated by it or for it.
    """

    file: str
    sha256: str
    exposure_time_s: float


@dataclass(frozen=True)
class ImportPlan:
    """Which pictures a session holds.

    Attributes
    ----------
    exposure_times : tuple of float, length E
        Nominal, seconds, ascending.
    poses : tuple of tuple of Source, length P
        The bracket of each pose, from short to long.
    darks, flats, ambient, response : tuple of Source
        Pictures beside the poses.
    """

    exposure_times: tuple[float, ...]
    poses: tuple[tuple[Source, ...], ...]
    darks: tuple[Source, ...] = ()
    flats: tuple[Source, ...] = ()
    ambient: tuple[Source, ...] = ()
    response: tuple[Source, ...] = ()

    @cached_property
    def json(self) -> str:
        """The plan as canonical JSON: sorted keys, no spaces, shortest digits that read back the same."""
        content: dict[str, Any] = {
            "kind": KIND,
            "version": PLAN_VERSION,
            "exposure_times_s": self.exposure_times,
            "poses": [[asdict(source) for source in pose] for pose in self.poses],
            **{name: [asdict(source) for source in getattr(self, name)] for name in BESIDE},
        }
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)

    @property
    def sha256(self) -> str:
        """Hex digest of `json`."""
        return text_digest(self.json)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> ImportPlan:
        """Return the plan that `json` wrote; raises KeyError, TypeError or ValueError if `data` is none."""
        return cls(
            exposure_times=tuple(data["exposure_times_s"]),
            poses=tuple(tuple(_sources(pose)) for pose in data["poses"]),
            **{name: tuple(_sources(data[name])) for name in BESIDE},
        )


BESIDE = ("darks", "flats", "ambient", "response")


def is_import(plan_json: str) -> bool:
    """Whether a session's plan is that of an import."""
    try:
        data = parse_json(plan_json)
    except ValueError:
        return False
    return isinstance(data, dict) and data.get("kind") == KIND


def _sources(entries: list[dict[str, Any]]) -> Iterator[Source]:
    for entry in entries:
        yield Source(str(entry["file"]), str(entry["sha256"]), float(entry["exposure_time_s"]))
