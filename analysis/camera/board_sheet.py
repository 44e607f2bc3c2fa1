"""Sheets to print: marker boards at true size, in their layout around the sample, with rulers and labels."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from analysis.camera.board_pattern import ink_rectangles
from analysis.drawing.pdf import LETTER_WIDTH, Page, Rectangle, Text, pdf
from instrument.files.validation import InvalidInputError, Problem
from instrument.session.records import Board

Paper = Literal["auto", "a4", "a3", "letter"]

PAPERS = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}
"""Width and height, mm."""

PAGE_MARGIN_MM = 5.0  # most printers leave 4.2 mm white

EDGE_MM = 5.0
"""White that stays around the boards where the sheet is cut."""

RULER_MM, RULER_ROOM_MM = 100.0, 8.0

_LETTERS_MM, _LINE_MM, _LEAST_LABEL_MM = 2.0, 2.8, 60.0

_STROKE_MM, _DASH_MM = 0.2, 2.0


@dataclass(frozen=True, slots=True)
class Sheets:
    """Pages of boards.

    Attributes
    ----------
    pages : tuple of Page
    paper : str
        ``"a4"`` and so on.
    boards : tuple of (int, float, float), on each page
        Which boards are on it, with the top left corner of each on the page, mm.
    """

    pages: tuple[Page, ...]
    paper: str
    boards: tuple[tuple[tuple[int, float, float], ...], ...]

    def pdf(self) -> bytes:
        """Return the pages as a file."""
        return pdf(self.pages, "halfangle boards")

    def as_text(self) -> str:
        """Return what was drawn, and how to print it."""
        pages = "1 page" if len(self.pages) == 1 else f"{len(self.pages)} pages"
        width, height = self.pages[0].size
        return (
            f"{sum(map(len, self.boards))} boards on {pages} of {self.paper}, {width:g} x {height:g} mm. "
            f"Print at 100 %, not fitted to the page, and measure both rulers: they are {RULER_MM:g} mm long"
        )


@dataclass(frozen=True, slots=True)
class _Block:
    """Boards that keep their places to each other; mm from its top left corner.

    Attributes
    ----------
    boards : tuple of (int, float, float)
        Number of each, and its top left corner.
    window : Rectangle or None
        The area to measure.
    size : tuple of float
        Of all this with its label.
    label : tuple of str
        Lines below the boards.
    label_at : tuple of float
        Where they begin.
    is_cut : bool
        Whether a line shows where to cut.
    """

    boards: tuple[tuple[int, float, float], ...]
    window: Rectangle | None
    size: tuple[float, float]
    label: tuple[str, ...]
    label_at: tuple[float, float]
    is_cut: bool


def board_sheets(boards: Sequence[Board], area_mm: tuple[float, float] | None, paper: Paper = "auto") -> Sheets:
    """Draw boards: those with a place together, as they are to lie, and the others one after another.

    Parameters
    ----------
    boards : sequence of Board
    area_mm : tuple of float or None
        Width and height of what is to be measured, about the origin of the sample frame.
    paper : str
        ``"auto"`` takes A4, and A3 if that is too small.

    Raises
    ------
    InvalidInputError
        If there are no boards, or they do not fit on the paper.
    """
    title = "The boards cannot be printed"
    if not boards:
        what = "there are none; state [[boards]], or see `halfangle boards --area-mm 60 60 -o boards.pdf`"
        raise InvalidInputError(title, [Problem("boards", what)])
    blocks = tuple(_blocks(boards, area_mm))
    names = ("a4", "a3") if paper == "auto" else (paper,)
    for name in names:
        for size in (PAPERS[name], PAPERS[name][::-1]):
            if all(_fits(block, size) for block in blocks):
                return _sheets(boards, blocks, name, size)
    largest = PAPERS[names[-1]]
    raise InvalidInputError(title, [_too_large(b, boards, names[-1]) for b in blocks if not _fits_turned(b, largest)])


def _blocks(boards: Sequence[Board], area_mm: tuple[float, float] | None) -> Iterator[_Block]:
    placed = [i for i, board in enumerate(boards) if board.is_placed]
    if placed:
        yield _layout(boards, placed, area_mm)
    for i, board in enumerate(boards):
        if not board.is_placed:
            size = _size(board)
            label = _wrapped([_line(i, board)], size[0])
            width = max(size[0], _label_width(label))
            room = (width, size[1] + _line_room(label))
            yield _Block(((i, 0.0, 0.0),), None, room, label, (0.0, size[1] + EDGE_MM), is_cut=False)


def _layout(boards: Sequence[Board], placed: Sequence[int], area_mm: tuple[float, float] | None) -> _Block:
    """Return the boards that have a place, as they are to lie, with room for the line to cut along."""
    boxes = [(*boards[i].corner_mm, *_size(boards[i])) for i in placed]
    left, right = min(x for x, _, _, _ in boxes), max(x + width for x, _, width, _ in boxes)
    top, bottom = max(y for _, y, _, _ in boxes), min(y - height for _, y, _, height in boxes)
    half = (0.0, 0.0)
    if area_mm is not None:
        half = (0.5 * area_mm[0], 0.5 * area_mm[1])
        left, right, top, bottom = min(left, -half[0]), max(right, half[0]), max(top, half[1]), min(bottom, -half[1])
    x0, y0 = left - EDGE_MM, top + EDGE_MM
    window = (-half[0] - x0, y0 - half[1], half[0] - x0, y0 + half[1]) if area_mm is not None else None
    lines = [*(_line(i, boards[i]) for i in placed), *(() if area_mm is None else (_window_line(area_mm),))]
    label = _wrapped(lines, right - left)
    width = max(right - left, _label_width(label)) + 2 * EDGE_MM
    height = top - bottom + 2 * EDGE_MM + _line_room(label)
    places = tuple((i, x - x0, y0 - y) for i, (x, y, _, _) in zip(placed, boxes, strict=True))
    # The powers of the light are measured on the white between the boards: letters lie below all of them.
    return _Block(places, window, (width, height), label, (EDGE_MM, top - bottom + 2 * EDGE_MM), is_cut=True)


def _size(board: Board) -> tuple[float, float]:
    return (board.squares[0] * board.square_mm, board.squares[1] * board.square_mm)


def _line(i: int, board: Board) -> str:
    across, down = board.squares
    marker = f", marker_mm {board.marker_mm:g}, {board.dictionary}, first_id {board.first_id}"
    place = f", corner_mm {board.corner_mm[0]:g}, {board.corner_mm[1]:g}" if board.is_placed else ""
    kind = marker if board.kind == "charuco" else ""
    return f"boards[{i}]: {board.kind}, squares {across} x {down}, square_mm {board.square_mm:g}{kind}{place}"


def _window_line(area_mm: tuple[float, float]) -> str:
    return f"Frame: the sample, {area_mm[0]:g} x {area_mm[1]:g} mm. Dashes: cut here. This text is at the bottom."


def _wrapped(lines: Sequence[str], width_mm: float) -> tuple[str, ...]:
    """Break lines at the width of the boards above them, or what one can read."""
    n_letters = int(max(width_mm, _LEAST_LABEL_MM) / (LETTER_WIDTH * _LETTERS_MM))
    return tuple(part for line in lines for part in textwrap.wrap(line, n_letters, subsequent_indent="  "))


def _label_width(label: Sequence[str]) -> float:
    return LETTER_WIDTH * _LETTERS_MM * max(map(len, label))


def _line_room(label: Sequence[str]) -> float:
    return len(label) * _LINE_MM + EDGE_MM


def _fits(block: _Block, page: tuple[float, float]) -> bool:
    return all(need <= have for need, have in zip(_needed(block), page, strict=True))


def _fits_turned(block: _Block, page: tuple[float, float]) -> bool:
    return _fits(block, page) or _fits(block, page[::-1])


def _needed(block: _Block) -> tuple[float, float]:
    """Return the size of paper that a block needs, with the rulers and the margin that no printer prints on."""
    width, height = (max(side, RULER_MM) + RULER_ROOM_MM + 2 * PAGE_MARGIN_MM for side in block.size)
    return (width, height)


def _too_large(block: _Block, boards: Sequence[Board], paper: str) -> Problem:
    numbers = [i for i, _, _ in block.boards]
    where = "the layout" if block.is_cut else f"boards[{numbers[0]}]"
    what = "the boards in their places" if block.is_cut else "the board"
    width, height = _needed(block)
    w, h = PAPERS[paper]
    remedy = (
        'boards with corner_mm = "measure" are printed one by one, and lie anywhere'
        if block.is_cut
        else "use smaller squares"
    )
    larger = "" if paper == "a3" else "try --paper a3, or "
    return Problem(
        where,
        f"{what} with label and rulers need {width:.0f} x {height:.0f} mm of paper; {paper} has {w:g} x {h:g} mm, "
        f"either way round; {larger}{remedy}",
    )


def _sheets(boards: Sequence[Board], blocks: Sequence[_Block], paper: str, size: tuple[float, float]) -> Sheets:
    pages, on_pages = [], []
    for group in _pages(blocks, size[1]):
        page, places = _page(boards, group, size)
        pages.append(page)
        on_pages.append(places)
    return Sheets(tuple(pages), paper, tuple(on_pages))


def _pages(blocks: Sequence[_Block], height: float) -> list[list[_Block]]:
    """Put blocks below each other, and on a new page where no room is left; a layout has a page of its own."""
    pages: list[list[_Block]] = []
    for block in blocks:
        together = [*pages[-1], block] if pages and not pages[-1][0].is_cut else [block]
        needed = _height(together) + RULER_ROOM_MM + 2 * PAGE_MARGIN_MM
        if len(together) > 1 and needed <= height:
            pages[-1] = together
        else:
            pages.append([block])
    return pages


def _height(blocks: Sequence[_Block]) -> float:
    return sum(block.size[1] for block in blocks) + EDGE_MM * (len(blocks) - 1)


def _page(
    boards: Sequence[Board], blocks: Sequence[_Block], size: tuple[float, float]
) -> tuple[Page, tuple[tuple[int, float, float], ...]]:
    """Draw blocks in the middle of a page, with a ruler at their left and one below."""
    width, height = max(block.size[0] for block in blocks), _height(blocks)
    x0 = 0.5 * (size[0] - RULER_ROOM_MM - max(width, RULER_MM)) + RULER_ROOM_MM
    y0 = top = 0.5 * (size[1] - RULER_ROOM_MM - max(height, RULER_MM))
    shapes: list[tuple[Rectangle, ...]] = []
    texts: list[Text] = []
    places: list[tuple[int, float, float]] = []
    for block in blocks:
        places += [(i, x0 + x, top + y) for i, x, y in block.boards]
        shapes += [_lines_of(block, x0, top)] if block.is_cut else []
        x, y = x0 + block.label_at[0], top + block.label_at[1]
        texts += [Text(x, y + n * _LINE_MM, _LETTERS_MM, line) for n, line in enumerate(block.label)]
        top += block.size[1] + EDGE_MM
    shapes += [_ink(boards[i], x, y) for i, x, y in places]
    across, below = y0 + max(height, RULER_MM) + 0.5 * RULER_ROOM_MM, x0 - 0.5 * RULER_ROOM_MM
    shapes += [_ruler(x0, across, upright=False), _ruler(below, y0, upright=True)]
    mark = f"{RULER_MM:g} mm"
    texts += [Text(x0 + RULER_MM + 1.0, across + 0.7, _LETTERS_MM, mark)] if size[0] - x0 > RULER_MM + 15.0 else []
    texts += [Text(below + 0.7, y0 + RULER_MM + 10.0, _LETTERS_MM, mark, upwards=True)]
    return Page(size, tuple(shapes), tuple(texts)), tuple(places)


def _ink(board: Board, x: float, y: float) -> tuple[Rectangle, ...]:
    return tuple((x + a, y + b, x + c, y + d) for a, b, c, d in ink_rectangles(board).tolist())


def _lines_of(block: _Block, x: float, y: float) -> tuple[Rectangle, ...]:
    """Return the frame of the sample, around it, and dashes along the block's edge."""
    edge = (x, y, x + block.size[0], y + block.size[1])
    lines = [dash for line in _frame(edge) for dash in _dashed(line)]
    if block.window is not None:
        left, top, right, bottom = block.window
        lines += _frame((x + left, y + top, x + right, y + bottom))
    return tuple(lines)


def _frame(inside: Rectangle) -> list[Rectangle]:
    """Return four thin rectangles around one."""
    left, top, right, bottom = inside
    s = _STROKE_MM
    return [
        (left - s, top - s, right + s, top),
        (left - s, bottom, right + s, bottom + s),
        (left - s, top, left, bottom),
        (right, top, right + s, bottom),
    ]


def _dashed(line: Rectangle) -> Iterator[Rectangle]:
    left, top, right, bottom = line
    lengthwise = right - left > bottom - top
    n = int(max(right - left, bottom - top) / (2 * _DASH_MM)) + 1
    for start in (2 * _DASH_MM * i for i in range(n)):
        if lengthwise:
            yield (left + start, top, min(left + start + _DASH_MM, right), bottom)
        else:
            yield (left, top + start, right, min(top + start + _DASH_MM, bottom))


def _ruler(x: float, y: float, *, upright: bool) -> tuple[Rectangle, ...]:
    """Return a line of `RULER_MM` with marks at each centimetre; its ends are the outer edges of the last marks."""
    s, step = _STROKE_MM, 10.0
    along = [(0.0, RULER_MM, -0.5 * s, 0.5 * s)]
    for i in range(int(RULER_MM / step) + 1):
        start = min(max(i * step - 0.5 * s, 0.0), RULER_MM - s)
        along.append((start, start + s, -1.5, 1.5))
    if upright:
        return tuple((x + low, y + start, x + high, y + end) for start, end, low, high in along)
    return tuple((x + start, y + low, x + end, y + high) for start, end, low, high in along)
