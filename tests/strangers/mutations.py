"""Ways in which a valid file is damaged or made hostile; each follows from its seed alone."""

import random
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

Bytes = Callable[[random.Random, bytearray], bytearray]
Structure = Callable[[random.Random, h5py.File], None]


def flip(rng: random.Random, content: bytearray) -> bytearray:
    for _ in range(rng.choice([1, 1, 2, 8, 64])):
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    return content


def overwrite(rng: random.Random, content: bytearray) -> bytearray:
    for _ in range(rng.choice([1, 4, 16])):
        content[rng.randrange(len(content))] = rng.choice([0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)])
    return content


def zero_block(rng: random.Random, content: bytearray) -> bytearray:
    n = rng.choice([4, 16, 64, 512])
    at = rng.randrange(max(1, len(content) - n))
    content[at : at + n] = bytes(n)
    return content


def copy_block(rng: random.Random, content: bytearray) -> bytearray:
    n = rng.choice([8, 64, 512])
    start, at = (rng.randrange(max(1, len(content) - n)) for _ in range(2))
    content[at : at + n] = content[start : start + n]
    return content


def swap_blocks(rng: random.Random, content: bytearray) -> bytearray:
    n = rng.choice([8, 32, 256])
    a, b = (rng.randrange(max(1, len(content) - n)) for _ in range(2))
    content[a : a + n], content[b : b + n] = content[b : b + n], content[a : a + n]
    return content


def cut(rng: random.Random, content: bytearray) -> bytearray:
    return content[: rng.randrange(len(content))]


BYTES: tuple[Bytes, ...] = (flip, overwrite, zero_block, copy_block, swap_blocks, cut)

# The texts of HDF5's heap and its headers are a small part of a file and the most dangerous one.
SIGNATURES = (b"GCOL", b"OHDR", b"OCHK", b"TREE", b"SNOD", b"HEAP", b"FRHP", b"FHDB", b"BTHD", b"BTLF")


def near_a_signature(rng: random.Random, content: bytearray) -> bytearray:
    found = [i for mark in SIGNATURES for i in _all(content, mark)]
    at = rng.choice(found or [0]) + rng.randrange(96)
    for i in range(at, min(at + rng.choice([1, 2, 8]), len(content))):
        content[i] = rng.choice([0, 1, 0x80, 0xFF, rng.randrange(256)])
    return content


def _all(content: bytearray, mark: bytes) -> list[int]:
    found, at = [], content.find(mark)
    while at >= 0:
        found.append(at)
        at = content.find(mark, at + 1)
    return found


def names(file: h5py.File, kind: type = h5py.HLObject) -> list[str]:
    found: list[str] = []
    file.visititems(lambda name, item: found.append(name) if isinstance(item, kind) else None)
    return sorted(found)


def remove(rng: random.Random, file: h5py.File) -> None:
    del file[rng.choice(names(file))]


VALUES: tuple[Any, ...] = (
    np.nan, -1, 2**62, b"", "\x1b[2J\u202e", "[" * 5000, "{}", "[1]", '"x"', "9" * 5000, np.zeros((0,)),
    np.zeros((2, 3, 4)),
    np.full((3, 2), np.inf), np.array([1 + 2j]), np.array([(1, 2.0)], "i4,f8"), np.array([True]), h5py.Empty("f8"),
    np.array([b"a" * 300]), np.array(["x", "y"], h5py.string_dtype()), np.void(b"opaque"), 1e308, -0.0, 0,
)  # fmt: skip


def other_value(rng: random.Random, file: h5py.File) -> None:
    name = rng.choice(names(file, h5py.Dataset))
    del file[name]
    file[name] = rng.choice(VALUES)


def other_values_of_the_same_type(rng: random.Random, file: h5py.File) -> None:
    dataset = file[rng.choice(names(file, h5py.Dataset))]
    _values(dataset)
    if dataset.dtype.kind == "f":
        dataset[...] = rng.choice([np.nan, np.inf, -1.0, 0.0, 1e30, 1e-300])
    elif dataset.dtype.kind in "iu":
        info = np.iinfo(dataset.dtype)
        dataset[...] = rng.choice([info.min, info.max, 0, 1])
    elif dataset.dtype.kind == "O":
        dataset[...] = rng.choice([text for text in VALUES if isinstance(text, str)])
    else:
        dataset[...] = rng.choice([b"", b"\xff\xfe", b"z" * 64])


def one_bad_number(rng: random.Random, file: h5py.File) -> None:
    found = [name for name in names(file, h5py.Dataset) if file[name].dtype.kind in "fiu" and file[name].size]
    dataset = file[rng.choice(found)]
    at = tuple(rng.randrange(size) for size in dataset.shape)
    bad = [np.nan, np.inf, -1e9, 1e300] if dataset.dtype.kind == "f" else [0, 1, 99]
    with np.errstate(over="ignore"):
        dataset[at] = np.asarray(rng.choice(bad)).astype(dataset.dtype)


def huge(rng: random.Random, file: h5py.File) -> None:
    name = rng.choice(names(file, h5py.Dataset))
    rank = rng.choice([len(file[name].shape), 1, 4])
    shape = tuple(rng.choice([1, 3, 1000, 2**20, 2**40]) for _ in range(rank)) or (2**40,)
    if np.prod(shape, dtype=float) * 8 > 2**62:
        return
    dtype = rng.choice([file[name].dtype, np.dtype("f8")])
    packed = rng.choice(["gzip", "lzf", None])
    del file[name]
    chunks = tuple(min(size, rng.choice([1, 16, 256])) for size in shape)
    file.create_dataset(name, shape, dtype, chunks=chunks, compression=packed)


def _values(dataset: h5py.Dataset) -> Any:
    """Return all values, unless another change has made them too many."""
    if dataset.size is not None and dataset.size > 10**6:
        raise ValueError("too many")
    return dataset[()]


def other_shape(rng: random.Random, file: h5py.File) -> None:
    name = rng.choice(names(file, h5py.Dataset))
    values = _values(file[name])
    del file[name]
    values = np.asarray(values)
    shapes = [values[None], values.ravel(), values[..., None], values[:1] if values.ndim else values]
    dtype = h5py.string_dtype() if values.dtype == object else values.dtype
    file.create_dataset(name, data=rng.choice(shapes), dtype=dtype)


def other_type(rng: random.Random, file: h5py.File) -> None:
    found = [name for name in names(file, h5py.Dataset) if file[name].dtype.kind in "fiu"]
    name = rng.choice(found)
    shape = file[name].shape
    del file[name]
    kind = rng.choice(
        ["f2", "f4", "f8", "i1", "u8", "c8", "S7", "?", "V5", "ref", "compound", "vlen", "enum", "committed"]
    )
    special: dict[str, Any] = {
        "ref": h5py.ref_dtype,
        "compound": np.dtype([("a", "f4"), ("b", "S3")]),
        "vlen": h5py.vlen_dtype("f4"),
        "enum": h5py.enum_dtype({"a": 0, "b": 1}, "u1"),
        "committed": "f4",
    }
    if kind == "committed":
        file[name] = np.dtype("f4")
        return
    file.create_dataset(name, shape, special.get(kind) or np.dtype(kind))


def lead_out(rng: random.Random, file: h5py.File) -> None:
    name = rng.choice(names(file))
    del file[name]
    file[name] = rng.choice([
        h5py.ExternalLink("other.h5", "/x"),
        h5py.ExternalLink(file.filename, "/" + name),
        h5py.SoftLink("/" + name),
        h5py.SoftLink("/nowhere"),
        h5py.SoftLink("/entry"),
        h5py.SoftLink(rng.choice(["..", ".", "entry", "/"])),
    ])  # fmt: skip


def hard_link_elsewhere(rng: random.Random, file: h5py.File) -> None:
    a, b = rng.choice(names(file)), rng.choice(names(file))
    target = file[a]
    if b != a:
        del file[b]
        if not b.startswith(a + "/") or b.rpartition("/")[0] in file:
            file[b] = target


def endless(rng: random.Random, file: h5py.File) -> None:
    group = rng.choice(names(file, h5py.Group))
    file[group]["loop"] = file[rng.choice([group, group.split("/")[0]])]


def virtual(rng: random.Random, file: h5py.File) -> None:
    name = rng.choice(names(file, h5py.Dataset))
    shape, dtype = file[name].shape or (1,), file[name].dtype
    del file[name]
    if rng.random() < 0.5:
        Path(file.filename + ".bin").write_bytes(b"secret")
        file.create_dataset(name, shape, "u1", external=[(file.filename + ".bin", 0, h5py.h5f.UNLIMITED)])
        return
    layout = h5py.VirtualLayout(shape, dtype)
    layout[...] = h5py.VirtualSource("other.h5", "x", shape)
    file.create_virtual_dataset(name, layout)


def attributes(rng: random.Random, file: h5py.File) -> None:
    thing = file[rng.choice(names(file))]
    name = rng.choice([*thing.attrs, "units", "pixels", "calibration", "halfangle_schema", "dictionary"])
    thing.attrs[name] = rng.choice([value for value in VALUES if not isinstance(value, np.void)])


def exotic_filter(rng: random.Random, file: h5py.File) -> None:
    found = [name for name in names(file, h5py.Dataset) if file[name].dtype.kind in "fiu" and file[name].size > 1]
    name = rng.choice(found)
    values = _values(file[name])
    del file[name]
    options = rng.choice([
        {"scaleoffset": 3}, {"compression": 307}, {"fletcher32": True}, {"compression": "gzip"}, {"compression": 32015},
    ])  # fmt: skip
    file.create_dataset(name, data=values, **options)


STRUCTURES: tuple[Structure, ...] = (
    remove, other_value, other_value, other_values_of_the_same_type, other_values_of_the_same_type, one_bad_number,
    huge, huge, other_shape, other_type, other_type, lead_out, hard_link_elsewhere, endless, virtual, attributes,
    attributes, exotic_filter,
)  # fmt: skip


def mutate(source: Path, target: Path, seed: int) -> str:
    """Write a mutation of `source`; return what was done."""
    rng = random.Random(seed)
    content = source.read_bytes()
    if rng.random() < 0.5:
        how = rng.choice((*BYTES, near_a_signature, near_a_signature))
        target.write_bytes(how(rng, bytearray(content)))
        return how.__name__
    target.write_bytes(content)
    done = []
    with h5py.File(target, "r+") as file:
        for _ in range(rng.choice([1, 1, 2])):
            change = rng.choice(STRUCTURES)
            done.append(change.__name__)
            # Another change may have left nothing to be changed.
            with suppress(LookupError, ValueError, TypeError, OSError, RuntimeError):
                change(rng, file)
    return " ".join(done)
