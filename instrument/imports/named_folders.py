"""Folders whose names say what their pictures are: `views`, `darks` and `flats` beside each other."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from instrument.files.validation import Problem
from instrument.imports.finder import natural_order
from instrument.pictures.reading import KNOWN_KINDS, READERS, is_picture, is_raw

VIEWS, BESIDE = "views", ("darks", "flats")

# More names nobody reads.
_SHOWN = 3


@dataclass(frozen=True, slots=True)
class NamedFolders:
    """What lies in a folder, by the names of the folders in it.

    Attributes
    ----------
    views : tuple of Path
        Pictures of the folder `views`; where there is none, those that lie in no folder called otherwise.
    has_views : bool
        Whether there is one.
    beside : dict of str to tuple of Path
        Pictures of `darks` and `flats`, where there are such folders.
    unnamed : tuple of Path
        Pictures beside the folder `views`, of which nothing says what they are.
    problems : tuple of Problem
        What the names leave open.
    """

    views: tuple[Path, ...]
    has_views: bool
    beside: dict[str, tuple[Path, ...]]
    unnamed: tuple[Path, ...]
    problems: tuple[Problem, ...]


def named_folders(folder: Path) -> NamedFolders:
    """Look at what lies in a folder; capital letters in the names of its folders mean nothing."""
    found = {name: _called(folder, name) for name in (VIEWS, *BESIDE)}
    places = {name: paths[0] for name, paths in found.items() if paths}
    has_views = VIEWS in places
    views = _pictures(places[VIEWS]) if has_views else _pictures(folder, set(places.values()))
    suffix = views[0].suffix.lower() if views else ""
    beside = {name: _pictures(places[name], like=suffix) for name in BESIDE if name in places}
    unnamed = [path for path in folder.iterdir() if path.is_file() and is_picture(path)] if has_views else []
    in_folders = {**({VIEWS: views} if has_views else {}), **beside}
    problems = [*_ambiguous(found), *_empty(places, in_folders)]
    return NamedFolders(views, has_views, beside, tuple(sorted(unnamed)), tuple(problems))


def has_views(folder: Path) -> bool:
    """Whether a folder has one called views."""
    return bool(_called(folder, VIEWS))


def unnamed_text(folders: NamedFolders) -> str:
    """Return how many pictures lie beside the folders, and which."""
    names = [path.name for path in folders.unnamed]
    more = ", ..." if len(names) > _SHOWN else ""
    pictures = "1 picture lies" if len(names) == 1 else f"{len(names)} pictures lie"
    return f"{pictures} beside the folder {VIEWS} ({', '.join(names[:_SHOWN])}{more})"


def called_otherwise(name: str, glob: str) -> str:
    """Return which of `darks` and `flats` a picture lies in, "" for none; not where `glob` asks for that folder."""
    first = name.split("/", maxsplit=1)[0].lower() if "/" in name else ""
    return first if first in BESIDE and glob.split("/", maxsplit=1)[0].lower() != first else ""


def _called(folder: Path, name: str) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_dir() and path.name.lower() == name)


def _ambiguous(found: dict[str, list[Path]]) -> Iterator[Problem]:
    for name, paths in found.items():
        if len(paths) > 1:
            names = " and ".join(path.name for path in paths)
            yield Problem(name, f"there are the folders {names}; which one is meant? Rename the others")


def _empty(places: dict[str, Path], pictures: dict[str, tuple[Path, ...]]) -> Iterator[Problem]:
    for name, paths in pictures.items():
        if not paths:
            remedy = "put them there, or remove it" if name in BESIDE else f"known are {KNOWN_KINDS}"
            yield Problem(places[name].name, f"the folder holds no picture; {remedy}")


def _pictures(folder: Path, leave_out: Collection[Path] = (), like: str = "") -> tuple[Path, ...]:
    """Return pictures of the kind `like`, or closest to the sensor; those in its folders if it has none itself."""
    kinds: dict[str, list[Path]] = defaultdict(list)
    for pattern in ("*", "*/*"):
        for path in folder.glob(pattern) if not kinds else ():
            if path.is_file() and is_picture(path) and path.parent not in leave_out:
                kinds[path.suffix.lower()].append(path)
    if not kinds:
        return ()
    best = like if like in kinds else min(kinds, key=lambda suffix: (_rank(suffix), -len(kinds[suffix])))
    return _in_order(folder, kinds[best])


def _in_order(folder: Path, paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(sorted(paths, key=lambda path: natural_order(path.relative_to(folder).as_posix())))


def _rank(suffix: str) -> int:
    return -1 if is_raw(Path(f"x{suffix}")) else list(READERS).index(suffix)
