"""Tables of presses by hand, with the names and units that people give their columns."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.datasets.press_tables import read_table


def written(folder: Path, text: str) -> Path:
    file = folder / 'presses.csv'
    file.write_text(text, encoding='utf-8')
    return file


@pytest.mark.parametrize(
    ('header', 'row', 'x_mm', 'force_n'),
    [
        ('picture,x_mm,y_mm,grams', 'a.png,-8,3,50', -8.0, 0.4905),
        ('picture,x_mm,y_mm,force_n', 'a.png,-8,3,0.5', -8.0, 0.5),
        ('Image,X (mm),Y (mm),Force [mN]', 'a.png,-8,3,500', -8.0, 0.5),
        ('file,x [cm],y [cm],mass_kg', 'a.png,-0.8,0.3,0.05', -8.0, 0.4905),
        ('filename,pos_x,pos_y,Force in N', 'a.png,-8,3,0.5', -8.0, 0.5),
        ('image_file;x/mm;y/mm;Newtons', 'a.png;-8,0;3,0;0,5', -8.0, 0.5),
        ('weight g\ty\tx\timg', '50\t3\t-8\ta.png', -8.0, 0.4905),
    ],
)
def test_columns_are_read_by_their_names_and_units(
    header: str, row: str, x_mm: float, force_n: float, tmp_path: Path
) -> None:
    _, rows = read_table(written(tmp_path, f'{header}\n{row}\n'))
    picture, contact = rows[0]
    assert picture == 'a.png'
    assert contact == pytest.approx((x_mm, 3.0, force_n))


def test_how_each_column_was_read_is_told_and_which_was_not(tmp_path: Path) -> None:
    told, _ = read_table(written(tmp_path, 'image,x,y_mm,Force [mN],note\na.png,1,2,300,wet\n'))
    assert (
        told
        == "picture from 'image'; x from 'x' in mm; y from 'y_mm' in mm; force from 'Force [mN]' in mN; not read: note"
    )


def test_the_mark_that_spreadsheets_write_first_is_no_part_of_a_name(tmp_path: Path) -> None:
    told, _ = read_table(written(tmp_path, '\ufeffpicture,x_mm,y_mm,grams\na.png,,,0\n'))
    assert told.startswith("picture from 'picture'")


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('picture,x,y,force\n', "column 'force' does not say its unit; write one of N, mN, g, kg behind its name"),
        ('picture,x,y,force_lbf\n', "column 'force_lbf' is in 'lbf'; write one of N, mN, g, kg"),
        ('picture,x_px,y_px,grams\n', "column 'x_px' is in 'px'; write one of um, mm, cm, m"),
        ('picture,x,y,grams,force_n\n', "'grams' and 'force_n' may both be the force; rename the one that is not"),
        ('picture,x_mm,grams\n', 'has no column for y; its first line may be picture,x_mm,y_mm,force_n'),
        ('', 'has no column for picture and x and y and force'),
        ('picture,x,y,grams\na.png,1,2\n', r'line 2 has 3 cells, and the first line has 4'),
        ('picture,x,y,grams\na.png,1,2,0,5\n', r'line 2 has 5 cells, and the first line has 4'),
        ('picture,x,y,grams\n\na.png,1,2,five\n', r"line 3: grams is 'five', and must be a number"),
        ('picture,x_m,y_m,grams\na.png,1,2,5\n', r'line 2: places lie within 16 mm of the middle; check the unit'),
    ],
)
def test_a_table_that_may_mean_several_things_is_refused_in_a_sentence(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(DatasetError) as caught:
        read_table(written(tmp_path, text))
    assert said in str(caught.value)
    assert '\n' not in str(caught.value)


def test_lines_may_end_as_on_old_machines(tmp_path: Path) -> None:
    (tmp_path / 'presses.csv').write_bytes(b'picture;x_mm;y_mm;force_n\ra.png;-8,0;3,0;0,5\ra,b,c,d.png;0;0;0\r')
    _, rows = read_table(tmp_path / 'presses.csv')
    assert rows == [('a.png', (-8.0, 3.0, 0.5)), ('a,b,c,d.png', (0.0, 0.0, 0.0))]


def test_a_table_in_other_letters_than_utf_8_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'presses.csv').write_bytes('picture,x_µm,y_mm,force_n\n'.encode('latin-1'))
    with pytest.raises(DatasetError, match=r'its first line names columns, as picture,x_mm,y_mm,force_n, in UTF-8$'):
        read_table(tmp_path / 'presses.csv')
