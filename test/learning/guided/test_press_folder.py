"""The table of presses by hand after a full disk or a power cut: what was written whole is gone on with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.cli.main import main
from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.guided.folder import PressFolder

HEADER = b'picture,x_mm,y_mm,force_g,indenter\n'
FIRST = b'press_0001.png,1,2,20,ball:0.6\n'
PICTURE = np.zeros((64, 64), np.uint8)


def folder_of(path: Path) -> PressFolder:
    return PressFolder(path, 'g', 'ball:0.6', (16.0, 16.0))


@pytest.mark.parametrize(
    ('cut', 'shown'),
    [
        (b'press_0002.png,1.5', "'press_0002.png,1.5'"),
        (b'press_0002.png,3,4,50,ball:0.6', "'press_0002.png,3,4,50,ball:0.6'"),  # or was it ball:0.65?
        (b'press_0002.png,3,4,50,kugel_\xc3', r"'press_0002.png,3,4,50,kugel_\\xc3'"),  # half of a letter
        (b'\0' * 31, "''"),  # the length was written, the content was not
    ],
)
def test_an_incomplete_last_line_is_left_out_and_shown(cut: bytes, shown: str, tmp_path: Path) -> None:
    table = tmp_path / 'presses.csv'
    table.write_bytes(HEADER + FIRST + cut)
    folder = folder_of(tmp_path)
    assert folder.left_out.startswith(f'the last line of {table} was incomplete and was left out: {shown}')
    assert table.read_bytes() == HEADER + FIRST
    folder.add_press(PICTURE, (5.0, 6.0), 50.0)
    again = folder_of(tmp_path)
    assert (again.left_out, [each[:2] for each in again.done]) == ('', [(1.0, 2.0), (5.0, 6.0)])


@pytest.mark.parametrize('cut', [b'', b'\0\0', HEADER[:9], HEADER[:-1]])
def test_a_table_of_less_than_its_first_line_begins_anew(cut: bytes, tmp_path: Path) -> None:
    (tmp_path / 'presses.csv').write_bytes(cut)
    folder_of(tmp_path).add_press(PICTURE, (1.0, 2.0), 20.0)
    assert (tmp_path / 'presses.csv').read_bytes() == HEADER + FIRST


def test_what_is_left_out_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A simulated hand has no ring, so that the command ends before it presses."""
    (tmp_path / 'presses.csv').write_bytes(HEADER + FIRST + b'press_0002.png,1.5')
    assert main(['press', str(tmp_path), '--indenter', 'ring']) == 1
    assert "was left out: 'press_0002.png,1.5'" in capsys.readouterr().out


def test_a_damaged_line_before_the_last_is_named(tmp_path: Path) -> None:
    (tmp_path / 'presses.csv').write_bytes(HEADER + b'press_00\n' + FIRST)
    with pytest.raises(DatasetError, match=r'presses.csv, line 2 has 1 cells, .* has 5: correct or delete it$'):
        folder_of(tmp_path)


@pytest.mark.parametrize('content', [b'picture,x,y,grams\na.png,1', b'picture,x,y,grams'])
def test_the_table_of_another_program_is_not_changed(content: bytes, tmp_path: Path) -> None:
    table = tmp_path / 'presses.csv'
    table.write_bytes(content)
    with pytest.raises(DatasetError, match='does not begin with picture,x_mm,y_mm,force_g,indenter'):
        folder_of(tmp_path)
    assert table.read_bytes() == content


def test_a_folder_that_was_begun_with_a_larger_sensor_asks_for_that_sensor(tmp_path: Path) -> None:
    folder_of(tmp_path).add_press(PICTURE, (1.0, 12.0), 20.0)
    with pytest.raises(DatasetError, match='line 2: 1, 12 mm lies beyond the bins of this sensor; give the --sensor'):
        PressFolder(tmp_path, 'g', 'ball:0.6', (12.5, 9.5))


def test_presses_with_another_indenter_are_kept_but_do_not_count_as_done(tmp_path: Path) -> None:
    """Else a second indenter in the same folder would be told at once that all presses are done."""
    folder_of(tmp_path).add_press(PICTURE, (1.0, 2.0), 20.0)
    punch = PressFolder(tmp_path, 'g', ' punch:2', (16.0, 16.0))
    assert punch.done == []
    punch.add_press(PICTURE, (3.0, 4.0), 50.0)
    assert [each[:2] for each in punch.done] == [(3.0, 4.0)]
    assert [row.indenter for row in punch.rows] == ['ball:0.6', 'punch:2']
