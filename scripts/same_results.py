"""Tells whether two results, stacks or benchmark reports hold the same figures, bit for bit.

    python scripts/same_results.py BEFORE AFTER [BEFORE AFTER ...]

For moves and clean-ups that must change no figure: keep a handful of files of the commit before, make them again with
the same input and seed, and compare. Times, memory, versions and the file a thing was made of are left out. Exits
with 1
if anything differs.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

# What differs between two runs of one program: clocks, memory, and what names the run.
_OF_THE_RUN = {
    "stages", "seconds", "cpu_seconds", "setup_seconds", "integration_seconds", "peak_mb", "pixels_per_s",
    "ratio_to_reference", "cpu_ratio_to_reference", "program_version", "file_time", "source", "load", "day", "machine",
    "versions", "session_uuid",
}  # fmt: skip


def main(arguments: list[str]) -> int:
    """Compare the files two by two."""
    if len(arguments) < 2 or len(arguments) % 2:
        sys.stderr.write(f"{__doc__}\n")
        return 2
    n_different = 0
    for before, after in zip(arguments[::2], arguments[1::2], strict=True):
        different = list(differences(Path(before), Path(after)))
        n_different += len(different)
        sys.stdout.write(f"{before} | {after}: {'the same' if not different else 'DIFFERENT'}\n")
        sys.stdout.writelines(f"  {text}\n" for text in different)
    return 1 if n_different else 0


def differences(before: Path, after: Path) -> Iterator[str]:
    """Yield what differs between two files."""
    if before.suffix == ".json":
        values = (json.loads(path.read_text(encoding="utf-8")) for path in (before, after))
        yield from _json_differences("", *values)
    else:
        with h5py.File(before) as one, h5py.File(after) as two:
            yield from _hdf5_differences(one, two)


def _hdf5_differences(one: Any, two: Any) -> Iterator[str]:
    if set(one) != set(two):
        yield f"{one.name}: {sorted(set(one) ^ set(two))} in one only"
    for name in sorted(set(one) & set(two) - _OF_THE_RUN):
        a, b = one[name], two[name]
        if isinstance(a, h5py.Group):
            yield from _hdf5_differences(a, b)
        elif h5py.check_string_dtype(a.dtype):
            yield from _text_differences(a.name, a, b)
        elif (a.dtype, a.shape) != (b.dtype, b.shape):
            yield f"{a.name}: {a.dtype} {a.shape}, now {b.dtype} {b.shape}"
        elif a[()].tobytes() != b[()].tobytes():
            yield f"{a.name}: {_how_far(a[()], b[()])}"


def _text_differences(name: str, a: Any, b: Any) -> Iterator[str]:
    one, two = (np.ravel(x.asstr()[()]).tolist() for x in (a, b))
    for text, other in zip(one, two, strict=True):
        try:
            yield from _json_differences(name, json.loads(text), json.loads(other))
        except ValueError:
            if text != other:
                yield f"{name}: {text!r}, now {other!r}"


def _json_differences(where: str, a: Any, b: Any) -> Iterator[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        for name in [*a, *(key for key in b if key not in a)]:
            if name in _OF_THE_RUN:
                continue
            if name not in a or name not in b:
                yield f"{where}.{name}: in one only"
            else:
                yield from _json_differences(f"{where}.{name}", a[name], b[name])
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for i, pair in enumerate(zip(a, b, strict=True)):
            yield from _json_differences(f"{where}[{i}]", *pair)
    elif a != b and not (isinstance(a, float) and isinstance(b, float) and np.isnan(a) and np.isnan(b)):
        yield f"{where}: {a!r}, now {b!r}"


def _how_far(a: Any, b: Any) -> str:
    if a.dtype.kind not in "fc":
        return f"{np.count_nonzero(a != b)} values differ"
    with np.errstate(invalid="ignore"):
        off = np.abs(a.astype(np.float64) - b)
    return f"{np.count_nonzero(~(off == 0))} values differ, by up to {np.nanmax(off, initial=0.0):.3g}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
