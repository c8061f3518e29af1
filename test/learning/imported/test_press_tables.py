"""Tables of presses by hand, with the names and units that people give their columns."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.tables.presses import read_table


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
        ('Photo,Pos X (mm),Pos Y (mm),Scale [g]', 'a.png,-8,3,50', -8.0, 0.4905),
        ('picture,x_mm,y_mm,scale reading g', 'a.png,-8,3,50', -8.0, 0.4905),
        ('picture,x_in,y_mm,force_n', 'a.png,-0.25,3,0.5', -6.35, 0.5),  # 25.4 mm an inch
        ('picture,x [inch],y in mm,force_n', 'a.png,-0.25,3,0.5', -6.35, 0.5),
        ('picture,x in,y,force_n', 'a.png,-0.25,3,0.5', -6.35, 0.5),
        ('picture,x (″),y,force_n', 'a.png,-0.25,3,0.5', -6.35, 0.5),
    ],
)
def test_columns_are_read_by_their_names_and_units(
    header: str, row: str, x_mm: float, force_n: float, tmp_path: Path
) -> None:
    (press,) = read_table(written(tmp_path, f'{header}\n{row}\n')).rows
    assert press.picture == 'a.png'
    assert (press.x_mm, press.y_mm, press.force_n) == pytest.approx((x_mm, 3.0, force_n))


def test_how_each_column_was_read_is_reported_and_which_was_not(tmp_path: Path) -> None:
    read = read_table(written(tmp_path, 'image,x,y_mm,Force [mN],note\na.png,1,2,300,wet\n'))
    assert (
        read.description
        == "picture from 'image'; x from 'x' in mm; y from 'y_mm' in mm; force from 'Force [mN]' in mN; not read: note"
    )


def test_the_mark_that_spreadsheets_write_first_is_no_part_of_a_name(tmp_path: Path) -> None:
    read = read_table(written(tmp_path, '\ufeffpicture,x_mm,y_mm,grams\na.png,,,0\n'))
    assert read.description.startswith("picture from 'picture'")


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('picture,x,y,force\n', "column 'force' has no unit; write one of N, mN, g, kg after its name"),
        ('picture,x,y,force_lbf\n', "column 'force_lbf' is in 'lbf'; write one of N, mN, g, kg"),
        ('picture,x_px,y_px,grams\n', "column 'x_px' is in 'px'; write one of um, mm, cm, m"),
        ('picture,x,y,grams,force_n\n', "both 'grams' and 'force_n' may be the force; rename the one that is not"),
        (
            'picture,x_mm,grams\n',
            "has no column for y; its columns are 'picture', 'x_mm', 'grams'; it needs picture (or time), x, y and "
            'force with its unit, as in picture,x_mm,y_mm,force_n',
        ),
        ('', 'has no column for picture and x and y and force; it is empty; it needs picture'),
        (
            ','.join(f'note {number}' for number in range(23)),
            "'note 18', 'note 19' and 3 more; it needs",
        ),
        (f'{"a" * 50},b\n', f"its columns are '{'a' * 40}', 'b'; it needs"),
        ('picture,x,y,grams\na.png,1,2\n', r'line 2 has 3 cells, but the first line has 4: correct or delete it'),
        (
            'picture,x,y,grams\na.png,1,2,0,5\n',
            'line 2 has 5 cells, but the first line has 4; numbers with decimal commas need semicolons between cells',
        ),
        ('picture,x,y,grams\n\na.png,1,2,five\n', r"line 3: grams is 'five', but must be a number"),
        (
            'picture,x_m,y_m,grams\na.png,1,2,5\n',
            'line 2: x_m is read as 1000 mm: places must be within 16 mm of the middle; check the unit',
        ),
        ('picture,x,y,grams,depth\na.png,1,2,5,-0.1\n', 'line 2: depth must be above 0, or empty if it is unknown'),
    ],
)
def test_a_table_that_may_mean_several_things_is_refused_in_a_sentence(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(DatasetError) as caught:
        read_table(written(tmp_path, text))
    assert said in str(caught.value)
    assert '\n' not in str(caught.value)


def test_lines_may_end_as_on_old_machines(tmp_path: Path) -> None:
    (tmp_path / 'presses.csv').write_bytes(b'picture;x_mm;y_mm;force_n\ra.png;-8,0;3,0;0,5\ra,b,c,d.png;0;0;0\r')
    rows = read_table(tmp_path / 'presses.csv').rows
    assert [(each.picture, each.x_mm, each.y_mm, each.force_n) for each in rows] == [
        ('a.png', -8.0, 3.0, 0.5), ('a,b,c,d.png', 0.0, 0.0, 0.0),
    ]  # fmt: skip


def test_numbers_with_commas_and_with_points_in_one_table_are_refused(tmp_path: Path) -> None:
    """As of a spreadsheet that separates thousands: 1,250 mN is 1.25 N, not 1.25 mN. Names and notes do not count."""
    lines = 'picture\tx\ty\tforce_mn\tnote', 'a.png\t1.5\t2\t850\t1,5', 'b.png\t1\t2\t1,250\t'
    with pytest.raises(DatasetError, match=r"line 3: force_mn is '1,250', but in line 2 x is '1\.5': .* thousands"):
        read_table(written(tmp_path, '\n'.join(lines)))
    assert read_table(written(tmp_path, '\n'.join(lines[:2]))).rows[0].x_mm == 1.5


@pytest.mark.parametrize('first', ['sep=;', '"sep=;"', 'SEP=;', '', ';;;'])
def test_a_first_line_without_names_is_skipped(first: str, tmp_path: Path) -> None:
    (row,) = read_table(written(tmp_path, f'{first}\npicture;x_mm;y_mm;grams\na.png;-8,5;3;50\n')).rows
    assert (row.line, row.x_mm) == (3, -8.5)


def test_commas_within_names_between_semicolons_are_no_separators(tmp_path: Path) -> None:
    (row,) = read_table(written(tmp_path, 'picture;x, mm;y, mm;force, N\na.png;-8,5;3;0,5\n')).rows
    assert (row.x_mm, row.y_mm, row.force_n) == (-8.5, 3.0, 0.5)


def test_a_table_in_other_letters_than_utf_8_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'presses.csv').write_bytes('picture,x_µm,y_mm,force_n\n'.encode('latin-1'))
    said = r'as in picture,x_mm,y_mm,force_n, in UTF-8 \(Excel saves that as CSV UTF-8\)$'
    with pytest.raises(DatasetError, match=said):
        read_table(tmp_path / 'presses.csv')


def test_components_torques_depth_and_indenter_are_read(tmp_path: Path) -> None:
    header = 'image;x;y;Fx [mN];Fy [mN];Fz [N];Tx [N mm];Ty (Nm);tz_mnm;depth_um;indenter'
    (press,) = read_table(written(tmp_path, f'{header}\na.png;1;2;30;-40;0,5;2;0,003;4;700;ball:5\n')).rows
    assert press.force_n == 0.5
    assert press.shear_n == pytest.approx((0.03, -0.04))
    assert press.torque_nm == pytest.approx((0.002, 0.003, 0.004))
    assert (press.depth_mm, press.indenter) == (pytest.approx(0.7), 'ball:5')


def test_micrometres_may_be_written_with_the_sign_for_micro_or_the_greek_letter(tmp_path: Path) -> None:
    """Both look alike; without its first letter the unit would be the metre, and the depth a million times as large."""
    for micro in '\u00b5\u03bc':
        table = written(tmp_path, f'picture,x [{micro}m],y_mm,force_n,depth ({micro}m)\na.png,-8000,3,0.5,700\n')
        (press,) = read_table(table).rows
        assert (press.x_mm, press.depth_mm) == pytest.approx((-8.0, 0.7))


def test_all_rows_with_a_fault_are_named_at_once(tmp_path: Path) -> None:
    rows = 'a.png,1,2,1\nb.png,1,2,-1\nc.png,1,99,1\nd.png,1,2,three\n'
    with pytest.raises(DatasetError, match=r'line 3: force_n must not be negative.*; 2 more .*: line 4, 5$'):
        read_table(written(tmp_path, f'picture,x_mm,y_mm,force_n\n{rows}'))


def test_what_a_gauge_reads_of_the_untouched_gel_is_no_force_where_that_is_said(tmp_path: Path) -> None:
    table = written(tmp_path, 'picture,x,y,force_n\na.png,,,-0.012\nb.png,0,0,0.021\n')
    assert [each.touches for each in read_table(table, untouched_n=0.02).rows] == [False, True]


GAUGE = 'picture,x,y,force_n\n' + ''.join(f'rest.png,,,{force}\n' for force in (-0.01, 0.01, -0.01, 0.02))


def test_small_forces_below_nothing_say_what_a_gauge_shows_of_nothing(tmp_path: Path) -> None:
    """Of -0.01, -0.01 and -0.02 N the root mean square is 0.0141 N, and four times that are noise."""
    read = read_table(written(tmp_path, f'{GAUGE}a.png,1,2,0.03\nb.png,1,2,1\nc.png,,,0.9\nd.png,1,2,-0.02\n'))
    assert [each.force_n for each in read.rows] == [0.0] * 4 + [0.03, 1.0, 0.9, 0.0]
    assert (
        'rows up to 0.057 N without a place, or below 0, count as the untouched gel, by their noise' in read.description
    )


@pytest.mark.parametrize('presses', ['a.png,1,2,-1\nb.png,1,2,-0.9\n', 'a.png,1,2,0.3\n', ''])
def test_forces_below_nothing_that_are_no_noise_are_refused_with_what_to_do(presses: str, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r'line 2: force_n must not be negative.*--untouched-below N'):
        read_table(written(tmp_path, f'{GAUGE}{presses}'))


NUMBERS = 'x_mm', 'y_mm', 'grams'


def test_a_parquet_table_says_the_same_as_its_csv(tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip('pyarrow'), pytest.importorskip('pyarrow.parquet')
    columns = {'picture': ['a.png', 'b.png'], 'x_mm': [None, -8.0], 'y_mm': [None, 3.0], 'grams': [0, 50]}
    ignored = {'notes': [[1, 2], [3]]}  # what is no plain column is not unpacked
    plain = arrow.table({**columns, **ignored})
    decimals = arrow.schema([('picture', arrow.string_view()), *((name, arrow.decimal128(21, 2)) for name in NUMBERS)])
    table = written(tmp_path, 'picture,x_mm,y_mm,grams\na.png,,,0\nb.png,-8.0,3.0,50\n')
    for each in (plain, plain.drop(['notes']).cast(decimals)):  # as DuckDB writes numbers, and Polars texts
        parquet.write_table(each, tmp_path / 'presses.parquet')
        assert repr(read_table(tmp_path / 'presses.parquet').rows) == repr(read_table(table).rows)


def test_a_parquet_file_that_is_none_is_one_sentence(tmp_path: Path) -> None:
    pytest.importorskip('pyarrow')
    (tmp_path / 'presses.parquet').write_bytes(b'PAR1 and then nothing PAR1')
    with pytest.raises(DatasetError, match=r'is not a readable Parquet file; write it again, or as CSV$'):
        read_table(tmp_path / 'presses.parquet')
