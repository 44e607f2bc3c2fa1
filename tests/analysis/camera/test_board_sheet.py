"""Sheets of boards: everything lies where it is stated, in the file and as it is rasterised and detected."""

from __future__ import annotations

import re
from itertools import pairwise
from types import ModuleType

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.camera.board_detection import detect_corners
from analysis.camera.board_layout import BoardLayout
from analysis.camera.board_pattern import charuco_board, chessboard_corners, ink_rectangles, pattern
from analysis.camera.board_sheet import PAPERS, Sheets, board_sheets
from analysis.light.white import border_points, white_points
from instrument.files.validation import InvalidInputError
from instrument.session.records import Board

DPI = 600
PX_PER_MM = DPI / 25.4
POINTS_PER_MM = 72 / 25.4
WORST_MM = 0.02

AREA = (60.0, 60.0)
AROUND = tuple(
    Board("charuco", "DICT_4X4_50", 8 * i, (4, 4), 5.5, 4.4, corner)
    for i, corner in enumerate([(-54.0, 54.0), (32.0, 54.0), (-54.0, -32.0), (32.0, -32.0)])
)
ANYWHERE = (np.nan, np.nan)
ALONE = (
    Board("charuco", "DICT_5X5_100", 3, (7, 5), 11.3, 8.7, ANYWHERE),
    Board("checkerboard", "", 0, (9, 6), 12.0, 0.0, ANYWHERE),
    Board("charuco", "DICT_APRILTAG_36h11", 40, (4, 5), 20.0, 15.0, ANYWHERE),
)


def rectangles(sheets: Sheets) -> NDArray[np.float64]:
    """Read the rectangles of the first page from the file: left, top, right, bottom, mm from its top left corner."""
    text = sheets.pdf().decode("latin-1")
    box = re.search(r"/MediaBox \[0 0 (\S+) (\S+)\]", text)
    assert box
    height = float(box.group(2)) / POINTS_PER_MM
    page = text[text.index("stream\n") : text.index("endstream")]
    assert page.split("\n")[1].startswith(f"{POINTS_PER_MM:.9f} 0 0 {POINTS_PER_MM:.9f} 0 0 cm")
    x, y, w, h = np.array(re.findall(r"^(\S+) (\S+) (\S+) (\S+) re$", page, re.MULTILINE), float).T
    return np.stack([x, height - y - h, x + w, height - y], axis=1)


def is_there(expected: NDArray[np.float64], drawn: NDArray[np.float64]) -> bool:
    apart = np.abs(expected[:, None] - drawn[None]).max(axis=2)
    return bool((apart.min(axis=1) < 2e-4).all())


@pytest.fixture(scope="module")
def rasteriser() -> ModuleType:
    return pytest.importorskip("pypdfium2", reason="pypdfium2 rasterises the sheets; the extra dev brings it")


def rasterised(rasteriser: ModuleType, sheets: Sheets) -> list[NDArray[np.uint8]]:
    with rasteriser.PdfDocument(sheets.pdf()) as document:
        return [np.asarray(page.render(scale=DPI / 72, grayscale=True).to_numpy()).squeeze() for page in document]


@pytest.mark.parametrize("board", [*AROUND[:1], *ALONE])
@pytest.mark.parametrize("legacy", [False, True])
def test_the_ink_is_that_of_the_pattern_that_corners_are_measured_against(board: Board, legacy: bool) -> None:
    n = 60
    picture = np.ones((board.squares[1] * n, board.squares[0] * n))
    edges = ink_rectangles(board, legacy) * n / board.square_mm
    for left, top, right, bottom in edges:
        across, down = (
            np.clip(np.minimum(high, k + 1) - np.maximum(low, k), 0, 1)
            for low, high, k in (
                (left, right, np.arange(picture.shape[1])),
                (top, bottom, np.arange(picture.shape[0])),
            )
        )
        picture -= down[:, None] * across[None]
    np.testing.assert_allclose(picture, pattern(board, n, legacy), atol=1e-5)


def test_the_file_says_its_size_and_that_it_is_not_to_be_scaled() -> None:
    content = board_sheets(AROUND, AREA).pdf()
    assert content.startswith(b"%PDF-1.6")
    assert b"/PrintScaling /None" in content
    assert b"/MediaBox [0 0 595.2756 841.8898]" in content
    table = int(content.split(b"startxref\n")[1].split()[0])
    starts = [int(line.split()[0]) for line in content[table:].split(b"\n")[3:] if line.endswith(b" n ")]
    assert len(starts) == 6
    assert all(content[start:].startswith(b"%d 0 obj" % n) for n, start in enumerate(starts, start=1))
    assert all(int(length) == len(stream) for length, stream in streams(content))


def streams(content: bytes) -> list[tuple[bytes, bytes]]:
    return re.findall(rb"/Length (\d+) >>\nstream\n(.*?)\nendstream", content, re.DOTALL)


def test_boards_lie_as_they_are_stated_to_each_other_and_to_the_sample() -> None:
    sheets = board_sheets(AROUND, AREA)
    drawn = rectangles(sheets)
    (places,) = sheets.boards
    at = {i: np.array([x, y]) for i, x, y in places}
    for i, x, y in places:
        assert is_there(ink_rectangles(AROUND[i]) + np.array([x, y, x, y]), drawn)
        stated = np.array(AROUND[i].corner_mm) - AROUND[0].corner_mm
        np.testing.assert_allclose((np.array([x, y]) - at[0]) * [1, -1], stated, atol=1e-9)
    left, top = at[0] + [54.0 - 30.0, 54.0 - 30.0]
    frame = np.array([[left - 0.2, top, left, top + 60.0], [left + 60.0, top, left + 60.2, top + 60.0]])
    assert is_there(frame, drawn)


def test_two_rulers_are_100_mm_long() -> None:
    width, height = (rectangles(board_sheets(AROUND, AREA))[:, axis + 2] for axis in (0, 1))
    drawn = rectangles(board_sheets(AROUND, AREA))
    width, height = drawn[:, 2] - drawn[:, 0], drawn[:, 3] - drawn[:, 1]
    for along, across, axis in ((width, height, 0), (height, width, 1)):
        (ruler,) = np.flatnonzero((np.abs(along - 100.0) < 1e-4) & (across < 0.3))
        marks = drawn[(np.abs(along - 0.2) < 1e-4) & (np.abs(across - 3.0) < 1e-4)]
        assert len(marks) == 11
        assert marks[:, axis].min() == pytest.approx(drawn[ruler, axis], abs=1e-4)
        assert marks[:, axis + 2].max() == pytest.approx(drawn[ruler, axis + 2], abs=1e-4)


def test_a_label_says_what_has_to_be_stated() -> None:
    label = " ".join(text.text.strip() for text in board_sheets(AROUND, AREA).pages[0].texts)
    for i in range(4):
        assert (
            f"boards[{i}]: charuco, squares 4 x 4, square_mm 5.5, marker_mm 4.4, DICT_4X4_50, first_id {8 * i}" in label
        )
    assert "corner_mm -54, 54" in label
    assert "boards[1]: checkerboard, squares 9 x 6, square_mm 12" in " ".join(
        text.text for page in board_sheets(ALONE, None).pages for text in page.texts
    )


@pytest.mark.parametrize("boards", [AROUND, AROUND[:1], AROUND[1:3]])
def test_nothing_is_printed_on_the_white_that_powers_are_measured_on(boards: tuple[Board, ...]) -> None:
    sheets = board_sheets(boards, AREA)
    layout = BoardLayout.nominal(boards)
    ((i, x, y), *_) = sheets.boards[0]
    origin = np.array([x - boards[i].corner_mm[0], y + boards[i].corner_mm[1]])
    white = [border_points(boards, layout, AREA, 2.5, 4.0)]
    white += [layout.place(k, white_points(board, 0.5, 0.3)) for k, board in enumerate(boards)]
    on_page = origin + np.concatenate(white)[:, :2] * [1, -1]
    ink = np.concatenate([rectangles(sheets), [text.rectangle for text in sheets.pages[0].texts]])
    away = np.maximum(ink[:, None, :2] - on_page, on_page - ink[:, None, 2:]).max(axis=2).min(axis=0)
    n_border = len(white[0])
    assert len(boards) < 4 or n_border > 50
    assert away.min() > 0.2
    assert n_border == 0 or away[:n_border].min() > 3.7


def test_boards_without_a_place_follow_one_another_and_do_not_touch() -> None:
    sheets = board_sheets(ALONE, AREA)
    assert sorted(i for places in sheets.boards for i, _, _ in places) == [0, 1, 2]
    for page, places in zip(sheets.pages, sheets.boards, strict=True):
        ends = [(y, y + ALONE[i].squares[1] * ALONE[i].square_mm) for i, _, y in places]
        assert all(first[1] + 5.0 < second[0] for first, second in pairwise(ends))
        boxes = np.array([text.rectangle for text in page.texts])
        for i, x, y in places:
            board = np.array(
                [x, y, x + ALONE[i].squares[0] * ALONE[i].square_mm, y + ALONE[i].squares[1] * ALONE[i].square_mm]
            )
            away = np.maximum(boxes[:, :2] - board[2:], board[:2] - boxes[:, 2:]).max(axis=1)
            assert away.min() > 1.0


@pytest.mark.parametrize("paper", ["a4", "a3", "letter"])
def test_everything_lies_within_what_printers_print(paper: str) -> None:
    for boards in (AROUND, ALONE):
        for page in board_sheets(boards, AREA, paper).pages:
            boxes = np.array([r for shape in page.shapes for r in shape] + [text.rectangle for text in page.texts])
            assert sorted(page.size) == sorted(PAPERS[paper])
            assert boxes[:, :2].min() > 4.5
            assert (np.array(page.size) - boxes[:, 2:].max(axis=0)).min() > 4.5


def test_larger_paper_is_taken_where_they_need_it() -> None:
    wide = tuple(
        Board("charuco", "DICT_4X4_50", 8 * i, (4, 4), 8.0, 6.4, (x, 16.0)) for i, x in enumerate((-120.0, 88.0))
    )
    sheets = board_sheets(wide, (150.0, 40.0))
    assert (sheets.paper, sheets.pages[0].size) == ("a4", (297.0, 210.0))
    larger = tuple(
        Board("charuco", "DICT_4X4_50", 8 * i, (4, 4), 8.0, 6.4, (x, 16.0)) for i, x in enumerate((-150.0, 118.0))
    )
    assert board_sheets(larger, (150.0, 40.0)).paper == "a3"


def test_what_does_not_fit_is_refused_with_what_it_needs() -> None:
    apart = (AROUND[0], Board("charuco", "DICT_4X4_50", 8, (4, 4), 5.5, 4.4, (500.0, 0.0)))
    with pytest.raises(InvalidInputError, match=r"the layout: .* need \d+ x \d+ mm of paper; a3 has 297 x 420 mm"):
        board_sheets(apart, None)
    large = Board("checkerboard", "", 0, (10, 7), 45.0, 0.0, ANYWHERE)
    with pytest.raises(InvalidInputError, match=r"boards\[1\]: the board with .* a4 has 210 x 297 mm, .*--paper a3"):
        board_sheets((ALONE[0], large), None, "a4")
    with pytest.raises(InvalidInputError, match=r"there are none; state \[\[boards\]\]"):
        board_sheets((), AREA)


def test_rasterised_pages_have_their_size(rasteriser: ModuleType) -> None:
    (page,) = rasterised(rasteriser, board_sheets(AROUND, AREA))
    np.testing.assert_allclose(np.array(page.shape) / PX_PER_MM, [297.0, 210.0], atol=1.5 / PX_PER_MM)


def expected_corners(sheets: Sheets, boards: tuple[Board, ...], i_page: int) -> dict[int, NDArray[np.float64]]:
    """Return where the corners of each board are on a page, mm from its top left corner."""
    return {i: np.array([x, y]) + chessboard_corners(boards[i]) for i, x, y in sheets.boards[i_page]}


def cut_out(
    page: NDArray[np.uint8], points: NDArray[np.float64], room: float
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Return the part of a page around points, and where its top left corner is, mm."""
    left, top = np.maximum(((points.min(axis=0) - room) * PX_PER_MM).astype(int), 0)
    right, bottom = ((points.max(axis=0) + room) * PX_PER_MM).astype(int)
    return np.ascontiguousarray(page[top:bottom, left:right]), np.array([left, top]) / PX_PER_MM


def off_by_mm(page: NDArray[np.uint8], boards: tuple[Board, ...], stated: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far each corner is detected from its stated place, mm; all of them are to be found."""
    part, origin = cut_out(page, stated, max(board.square_mm for board in boards) + 4.0)
    found = detect_corners(np.square(part.astype(np.float32) / 255.0), "", boards)
    assert found.corner.tolist() == list(range(len(stated)))
    return np.linalg.norm((found.image_points + 0.5) / PX_PER_MM + origin - stated, axis=1)


def test_every_corner_of_a_layout_is_detected_where_it_is_stated(rasteriser: ModuleType) -> None:
    sheets = board_sheets(AROUND, AREA)
    (page,) = rasterised(rasteriser, sheets)
    stated = np.concatenate(list(expected_corners(sheets, AROUND, 0).values()))
    assert off_by_mm(page, AROUND, stated).max() < WORST_MM


def test_every_corner_of_single_boards_is_detected_where_it_is_stated(rasteriser: ModuleType) -> None:
    sheets = board_sheets(ALONE, None)
    for i_page, page in enumerate(rasterised(rasteriser, sheets)):
        for i, stated in expected_corners(sheets, ALONE, i_page).items():
            assert off_by_mm(page, (ALONE[i],), stated).max() < WORST_MM


def test_opencv_finds_every_corner_where_it_is_stated(rasteriser: ModuleType) -> None:
    sheets = board_sheets(AROUND, AREA)
    (page,) = rasterised(rasteriser, sheets)
    for i, stated in expected_corners(sheets, AROUND, 0).items():
        part, origin = cut_out(page, stated, 8.0)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco_board(AROUND[i])).detectBoard(part)
        assert ids.ravel().tolist() == list(range(len(stated)))
        refined = cv2.cornerSubPix(part, corners, (15, 15), (-1, -1), (cv2.TERM_CRITERIA_EPS, 0, 1e-3))
        off = (refined.reshape(-1, 2) + 0.5) / PX_PER_MM + origin - stated
        assert np.linalg.norm(off, axis=1).max() < WORST_MM
