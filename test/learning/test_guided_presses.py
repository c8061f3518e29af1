"""A person who presses by hand is told where and how hard; what was pressed is kept, and a later session goes on."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tactile_nodes.cli.main import main
from tactile_nodes.cli.press import read_answer
from tactile_nodes.learning.guided.targets import Done, Target, Wish
from tactile_nodes.learning.tables.presses import read_table

WISH = Wish(presses=4, forces_n=(0.2, 0.5), sides_mm=(20.0, 10.0))


def test_the_first_place_is_the_middle_and_the_next_as_far_away_as_can_be() -> None:
    """Four fifths of 10 and 5 mm: the corners of what is pressed lie at (8, 4)."""
    assert WISH.next([]) == Target(0.0, 0.0, 0.2)
    second = WISH.next([Done(0.0, 0.0, 0.2)])
    assert second is not None
    assert (abs(second.x_mm), abs(second.y_mm), second.force_n) == (8.0, 4.0, 0.5)


def test_it_is_enough_when_all_were_made_also_those_of_which_nobody_knows_the_place() -> None:
    assert WISH.next([Done(math.nan, math.nan, 0.2)] * 3) is not None
    assert WISH.next([Done(math.nan, math.nan, 0.2)] * 4) is None


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('50', (50.0, (3.0, -1.0))),
        ('50,5 3.5 -2', (50.5, (3.5, -2.0))),
        ('s', None),
    ],
)
def test_a_reading_is_taken_with_its_place_or_for_the_mark(text: str, told: object) -> None:
    assert read_answer(text, (3.0, -1.0)) == told


def test_a_place_that_nobody_knows_is_none() -> None:
    told = read_answer('50 ?', (3.0, -1.0))
    assert isinstance(told, tuple)
    assert told[0] == 50.0
    assert all(map(math.isnan, told[1]))


@pytest.mark.parametrize('text', ['', 'fifty', '50 3', '-2', '0', 'nan', '50 ? 3'])
def test_an_answer_that_is_none_says_what_to_write(text: str) -> None:
    told = read_answer(text, (0.0, 0.0))
    assert isinstance(told, str)
    assert 'write the reading' in told or 'tare the scale' in told


def test_a_session_goes_on_where_it_stopped_and_keeps_every_press(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(tmp_path / 'by_hand')
    assert main(['press', folder, '--presses', '2', '--indenter', 'ball:3']) == 0
    assert '2 of 2 presses' in capsys.readouterr().out
    assert main(['press', folder, '--presses', '3', '--indenter', 'ball:3']) == 0
    rows = read_table(tmp_path / 'by_hand' / 'presses.csv', (16.0, 16.0)).rows
    pressed = [row for row in rows if row.touches]
    assert len(pressed) == 3
    assert (pressed[0].x_mm, pressed[0].y_mm) == (0.0, 0.0)
    # A hand is up to 15 % beside the 20 g that it is told: 0.196 N.
    assert pressed[0].force_n == pytest.approx(0.196, rel=0.16)
    assert all((tmp_path / 'by_hand' / row.picture).is_file() for row in rows)


def test_a_folder_of_another_unit_is_not_gone_on_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / 'by_hand')
    assert main(['press', folder, '--presses', '1']) == 0
    before = (tmp_path / 'by_hand' / 'presses.csv').read_text()
    assert main(['press', folder, '--presses', '2', '--unit', 'N']) == 1
    assert 'go on with the unit that it has' in capsys.readouterr().err
    assert (tmp_path / 'by_hand' / 'presses.csv').read_text() == before
