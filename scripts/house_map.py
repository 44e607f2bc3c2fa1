"""Draws the map of the house into CONTRIBUTING.md from the real imports: `make map`.

Rooms are the folders of each package; their words are the first lines of their docstrings. An arrow says "imports"; one
that follows from others is left out. `--check` says whether the map that is there is the one that would be drawn.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "CONTRIBUTING.md"
BEGIN, END = "<!-- map: made by `make map` -->\n", "<!-- end of the map -->\n"
PACKAGES = ("cli", "benchmarks", "gui", "protocols", "analysis", "instrument", "drivers")

Edges = dict[str, set[str]]


def main(arguments: list[str]) -> int:
    """Draw the map, or check it."""
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    drawn = before + BEGIN + the_map() + END + rest.split(END)[1]
    if "--check" in arguments:
        if drawn != text:
            sys.stderr.write(f"{PAGE.name}: the map is not that of the imports any more; run `make map`\n")
        return int(drawn != text)
    PAGE.write_text(drawn, encoding="utf-8")
    return 0


def the_map() -> str:
    """Return the drawing and the tables of rooms, as Markdown."""
    graph = grimp.build_graph(*PACKAGES)
    parts = ["\n```mermaid\n", *drawing(graph), "```\n\n"]
    for package in PACKAGES:
        parts += ["| " + f"{package}/ | {summary(ROOT / package)} |\n|---|---|\n", *rows(package), "\n"]
    return "".join(parts)


def rows(package: str) -> Iterator[str]:
    """Yield a line of the table for each room of a package."""
    for room in rooms_of(package):
        yield f"| {room}/ | {summary(ROOT / package / room)} |\n"


def rooms_of(package: str) -> list[str]:
    """Return the names of a package's rooms, in the alphabet's order."""
    return sorted(path.parent.name for path in (ROOT / package).glob("*/__init__.py"))


def summary(folder: Path) -> str:
    """Return the first line of a package's docstring, without its full stop."""
    words = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    return words.split("\n")[0].removesuffix(".")


def drawing(graph: grimp.ImportGraph) -> Iterator[str]:
    """Yield the lines of the Mermaid flowchart: packages, and the rooms of the analysis and the instrument in them."""
    yield "flowchart TD\n"
    for package in PACKAGES:
        rooms = rooms_of(package) if package != "drivers" else []
        if package in {"cli", "drivers"} or not rooms:
            yield f"  {package}\n"
            continue
        yield f"  subgraph {package}\n"
        for line in arrows(reduced(edges_between(graph, package, rooms)), f"{package}_"):
            yield f"    {line}\n"
        yield "  end\n"
    packages = {p: {q for q in PACKAGES if q != p and imports(graph, p, q)} for p in PACKAGES}
    for line in arrows(reduced(packages), ""):
        yield f"  {line}\n"


def edges_between(graph: grimp.ImportGraph, package: str, rooms: list[str]) -> Edges:
    """Return which room of a package imports which."""
    return {a: {b for b in rooms if a != b and imports(graph, f"{package}.{a}", f"{package}.{b}")} for a in rooms}


def imports(graph: grimp.ImportGraph, importer: str, imported: str) -> bool:
    """Tell whether anything in one package imports anything in another."""
    inside = {importer, *graph.find_descendants(importer)}
    wanted = {imported, *graph.find_descendants(imported)}
    return any(wanted & graph.find_modules_directly_imported_by(module) for module in inside)


def reduced(edges: Edges) -> Edges:
    """Leave out what follows from other edges (the transitive reduction)."""
    reach: Edges = {}

    def reached(node: str) -> set[str]:
        if node not in reach:
            reach[node] = edges[node].union(*(reached(other) for other in edges[node]))
        return reach[node]

    return {a: {b for b in to if not any(b in reached(c) for c in to if c != b)} for a, to in edges.items()}


def arrows(edges: Edges, prefix: str) -> Iterator[str]:
    """Yield a line for each edge, and one for each node without any."""
    used = {node for a, to in edges.items() for node in ((a, *to) if to else ())}
    for a in sorted(edges):
        if a not in used:
            yield _node(prefix, a)
        for b in sorted(edges[a]):
            yield f"{_node(prefix, a)} --> {_node(prefix, b)}"


def _node(prefix: str, name: str) -> str:
    return f"{prefix}{name}[{name}]" if prefix else name


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
