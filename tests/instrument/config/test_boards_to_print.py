"""Boards to print: those of a file, or four that are proposed."""

from __future__ import annotations

from pathlib import Path

import pytest

from instrument.config.boards import BoardConfig, board_misfits
from instrument.config.loading import load_rig
from instrument.config.proposed_boards import proposal_text, proposed_boards
from instrument.config.stated_boards import stated_boards
from instrument.files.validation import InvalidInputError
from tests.instrument.imports.folders import write_capture

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.mark.parametrize("area", [(60.0, 60.0), (10.0, 10.0), (150.0, 40.0), (33.3, 200.0)])
def test_what_is_proposed_reads_back_and_fits_its_area(area: tuple[float, float], tmp_path: Path) -> None:
    path = tmp_path / "boards.toml"
    path.write_text(proposal_text(area, "boards.pdf"))
    stated = stated_boards(path)
    assert stated.area_mm == area
    assert stated.boards == proposed_boards(area)
    configs = [BoardConfig(**{key: getattr(board, key) for key in BoardConfig.model_fields}) for board in stated.boards]
    around = (-area[0] / 2, -area[1] / 2, area[0] / 2, area[1] / 2)
    assert list(board_misfits(dict(enumerate(configs)), around, "the area")) == []


def test_the_example_has_the_proposed_boards() -> None:
    rig = load_rig(EXAMPLES / "simulated.toml")
    stated = stated_boards(EXAMPLES / "simulated.toml")
    assert stated.area_mm == rig.geometry.area_mm == (60.0, 60.0)
    assert stated.boards == tuple(board.record for board in rig.boards) == proposed_boards((60.0, 60.0))


def test_a_capture_file_and_one_of_boards_alone_are_read(tmp_path: Path) -> None:
    board = '[[boards]]\nkind = "checkerboard"\nsquares = [9, 6]\nsquare_mm = 5.0\ncorner_mm = "measure"\n'
    capture = stated_boards(write_capture(tmp_path, f'name = "leaf"\n{board}'))
    (tmp_path / "boards.toml").write_text(board)
    alone = stated_boards(tmp_path / "boards.toml")
    for stated in (capture, alone):
        assert stated.area_mm is None
        assert [(b.kind, b.squares, b.is_placed) for b in stated.boards] == [("checkerboard", (9, 6), False)]


def test_what_is_wrong_is_told_by_line(tmp_path: Path) -> None:
    path = tmp_path / "boards.toml"
    path.write_text(proposal_text((60.0, 60.0), "boards.pdf").replace("first_id = 8", "first_id = 1"))
    with pytest.raises(
        InvalidInputError, match=r"boards.toml:20: boards\[1\].first_id: .* overlap those of boards\[0\]"
    ):
        stated_boards(path)
