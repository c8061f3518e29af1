"""Tables that contradict their pictures, by ``tactile calibrate --pictures`` and ``tactile dataset import``."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from coarse_table import linear_table

from tactile_nodes.cli.main import main
from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.agreement.objections import (
    aside,
    description_objection,
    force_objection,
    places_objection,
)
from tactile_nodes.learning.agreement.stated_presses import require_seen
from tactile_nodes.learning.tables.columns import NEWTON_PER_GRAM
from tactile_nodes.learning.tables.presses import read_table
from tactile_nodes.sensors import BinSettings, CameraDescription, ImageSettings, PatternDescription, load_sensor
from tactile_nodes.sensors.writing import text_of
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.optics import Optics, Press

MEMBRANE = load_sensor('speckle_membrane')
SENSOR = dataclasses.replace(
    MEMBRANE, name='small_membrane', image=ImageSettings(320, 240, 320, 240), bins=BinSettings(5, 7),
    camera=dataclasses.replace(MEMBRANE.camera, focal_px=(256.0, 256.0), centre_px=(159.5, 119.5)),
    pattern=PatternDescription('spheres', 3000, (0.2, 0.3)),
)  # fmt: skip
"""Half as many pixels to a millimetre, and speckle of as many pixels."""
HEADER = 'picture,x_mm,y_mm,force_g,indenter'
RESTS = 4
Row = list[str]
Change = Callable[[list[Row]], object]

pytestmark = pytest.mark.usefixtures('own_cache')


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four pictures of an untouched gel, a grid of twelve presses by the tip, and the model of the description."""
    made = tmp_path_factory.mktemp('pictures')
    gel = dataclasses.replace(gel_of(SENSOR), mechanics='linear')
    table = linear_table(gel)
    optics, rows = Optics(gel, table), []
    for number in range(RESTS):
        cv2.imwrite(str(made / f'rest{number}.png'), optics.render((), number))
        rows.append([f'rest{number}.png', '', '', '0', ''])
    for number, (x, y) in enumerate((x, y) for y in (-6.5, 0.0, 6.5) for x in (-8.0, -3.0, 3.0, 8.0)):
        depth = 0.25 + 0.03 * (7 * number % 12)
        cv2.imwrite(str(made / f'press{number}.png'), optics.render((Press(x, y, depth),), 100 + number))
        grams = table.force_at(depth) / NEWTON_PER_GRAM
        rows.append([f'press{number}.png', str(x), str(y), f'{grams:.3f}', 'ball:0.6'])
    written(made / 'presses.csv', rows)
    (made / 'sensor.yaml').write_text(text_of(SENSOR, {}))
    described = ['--sensor', str(made / 'sensor.yaml'), '--model', 'field', '-o', str(made / 'described.safetensors')]
    assert main(['calibrate', *described]) == 0
    return made


def written(table: Path, rows: list[Row], header: str = HEADER) -> Path:
    table.write_text('\n'.join([header, *(','.join(row) for row in rows)]) + '\n')
    return table


def rows_of(table: Path) -> list[Row]:
    return [line.split(',') for line in table.read_text().splitlines()[1:]]


def edited(folder: Path, change: Change, header: str = HEADER) -> Path:
    rows = rows_of(folder / 'presses.csv')
    change(rows)
    return written(folder / 'edited.csv', rows, header)


def calibrated(table: Path, output: Path, *more: str) -> int:
    words = ['--model', str(table.parent / 'described.safetensors'), '--gel', 'mine', '-o', str(output)]
    return main(['calibrate', '--pictures', str(table), *words, *more])


def imported(table: Path, output: Path, *more: str) -> int:
    model = ['--model', str(table.parent / 'described.safetensors')]
    return main(['dataset', 'import', str(table), '-o', str(output), *model, *more])


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """With which words a command refuses a table, of which it then makes nothing."""

    def words_of(command: Callable[..., int], table: Path) -> str:
        assert command(table, tmp_path / 'made') == 1
        assert not (tmp_path / 'made').exists()
        return capsys.readouterr().err

    return words_of


def scaled(x: float, y: float) -> Change:
    def change(rows: list[Row]) -> None:
        for row in rows[RESTS:]:
            row[1:3] = str(x * float(row[1])), str(y * float(row[2]))

    return change


def exchanged(rows: list[Row]) -> None:
    for row in rows[RESTS:]:
        row[1], row[2] = row[2], row[1]


def slipped(column: int, by: int) -> Change:
    """A column slipped by some lines, as sorted alone in a spreadsheet."""

    def change(rows: list[Row]) -> None:
        values = [row[column] for row in rows[RESTS:]]
        for row, value in zip(rows[RESTS:], values[by:] + values[:by], strict=True):
            row[column] = value

    return change


def test_presses_that_are_stated_rightly_calibrate_their_model(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrated(folder / 'presses.csv', tmp_path / 'mine.safetensors') == 0
    assert 'does not move' not in capsys.readouterr().out
    assert imported(folder / 'presses.csv', tmp_path / 'mine.npz') == 0


@pytest.mark.parametrize(
    ('command', 'change', 'said'),
    [
        (calibrated, exchanged, 'x and y are swapped'),
        (imported, exchanged, 'x and y are swapped'),
        (imported, scaled(-1, 1), 'the images move along x in the opposite direction'),
        (imported, scaled(1, -1), 'the images move along y in the opposite direction'),
        (imported, slipped(0, 5), 'the images do not move at the places given in the table'),
        (imported, slipped(3, 6), 'the images do not move more when the given force is larger'),
    ],
)
def test_both_commands_refuse_a_table_that_contradicts_its_pictures(
    command: Callable[..., int], change: Change, said: str, folder: Path, refused: Callable[..., str]
) -> None:
    printed = refused(command, edited(folder, change))
    assert said in printed and '--force uses the table as it is' in printed


def test_forces_stated_alike_of_presses_that_differ_calibrate_no_model(
    folder: Path, refused: Callable[..., str]
) -> None:
    def change(rows: list[Row]) -> None:
        for number, row in enumerate(rows[RESTS:]):
            row[3] = str(20 + number % 2)

    assert 'the images show forces that differ by' in refused(calibrated, edited(folder, change))


def in_unit(rows: list[Row]) -> None:
    """As they are: another header says another unit."""


@pytest.mark.parametrize(
    ('command', 'unit', 'least', 'most'), [(calibrated, 'mn', 0.08, 0.13), (imported, 'n', 80.0, 130.0)]
)
def test_grams_under_a_header_of_another_unit_are_refused(
    command: Callable[..., int], unit: str, least: float, most: float, folder: Path, tmp_path: Path,
    refused: Callable[..., str],
) -> None:  # fmt: skip
    """A gram weighs 9.81 mN: read as mN it is 0.102 times as much, as N 102 times."""
    table = edited(folder, in_unit, HEADER.replace('force_g', f'force_{unit}'))
    printed = refused(command, table)
    found = re.search(r'forces are about (\S+) times those expected from the description: check the unit', printed)
    assert found and least < float(found[1]) < most
    if command is imported:
        assert command(table, tmp_path / 'made', '--force') == 0


def test_a_description_alone_tells_which_forces_to_expect(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = edited(folder, in_unit, HEADER.replace('force_g', 'force_mn'))
    words = ['dataset', 'import', str(table), '-o', str(tmp_path / 'x.npz'), '--sensor', str(folder / 'sensor.yaml')]
    assert main(words) == 1
    assert 'times those expected from the description' in capsys.readouterr().err


@pytest.mark.parametrize('command', [calibrated, imported])
def test_the_description_that_a_model_holds_is_checked(
    command: Callable[..., int], folder: Path, refused: Callable[..., str]
) -> None:
    """Places stated half as far out as they were: from each to the next the picture moves twice as far."""
    assert 'one of them is of another camera or gel' in refused(command, edited(folder, scaled(0.5, 0.5)))


@pytest.mark.parametrize(('by', 'said'), [(0.001, 'check the unit of x and y'), (0.1, 'places are in another unit')])
def test_places_in_metres_or_centimetres_that_are_read_as_millimetres_are_refused(
    by: float, said: str, folder: Path, refused: Callable[..., str]
) -> None:
    assert said in refused(imported, edited(folder, scaled(by, by)))


def test_presses_at_nearly_one_place_are_in_no_other_unit() -> None:
    random = np.random.default_rng(1)
    place_mm, seen = random.normal(0, 0.01, (30, 2)), random.uniform(0.2, 0.8, (30, 2))
    assert places_objection(place_mm, seen) == description_objection(place_mm, seen, SENSOR) == ''


def test_a_calibration_that_makes_the_camera_another_one_is_no_calibration(
    folder: Path, refused: Callable[..., str]
) -> None:
    """Places stated 1 / 1.35 times as far out, which is within what pictures show by themselves: a longer lens."""
    table = edited(folder, scaled(1 / 1.35, 1 / 1.35))
    assert 'the focal length of the camera differs by +' in refused(calibrated, table)


def test_motion_cannot_follow_forces_that_are_all_alike() -> None:
    motion = np.random.default_rng(1).uniform(0, 1, 20)
    assert force_objection(np.full(20, 0.49), motion) == ''
    assert 'do not move more' in force_objection(motion.max() - motion, motion)


def test_motion_that_also_depends_on_the_place_still_follows_forces() -> None:
    """As between a few printed dots: of 30 presses with 12 to 26 g some move the dots three times as much as others."""
    random = np.random.default_rng(0)
    force_n = np.tile([0.14, 0.19, 0.23], 10) * random.uniform(0.85, 1.15, 30)
    motion = force_n * random.uniform(0.5, 1.5, 30)
    ranks = [values.argsort().argsort() for values in (force_n, motion)]
    correlation = np.corrcoef(ranks)[0, 1]  # Spearman's
    assert 2 / math.sqrt(29) < correlation < 0.5
    assert force_objection(force_n, motion) == ''
    assert 'rows or columns are mixed up' in force_objection(random.permutation(force_n), motion)


@pytest.mark.parametrize('described', [['--sensor', 'simulated'], []])
def test_presses_that_a_wide_lens_shows_smaller_near_the_rim_are_imported(
    described: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Eight presses, harder from the middle to the rim by 1.4 times; at the rim a press moves fewer pixels."""
    sensor = load_sensor('simulated')
    gel = dataclasses.replace(gel_of(sensor), mechanics='linear')
    table = linear_table(gel)
    optics, rows = Optics(gel, table), []
    cv2.imwrite(str(tmp_path / 'rest.png'), optics.render((), 0))
    for number in range(8):
        x, y = (1.6 * (number + 1) * side(0.9 * number * math.pi) for side in (math.cos, math.sin))
        force_n = 0.15 * 1.4 ** (number / 7)
        press = Press(x, y, table.depth_at(force_n))
        cv2.imwrite(str(tmp_path / f'press{number}.png'), optics.render((press,), 1 + number))
        rows.append([f'press{number}.png', f'{x:.3f}', f'{y:.3f}', f'{force_n / NEWTON_PER_GRAM:.3f}', 'ball:0.6'])
    made = written(tmp_path / 'presses.csv', [['rest.png', '', '', '0', ''], *rows])
    words = ['dataset', 'import', str(made), *described]
    assert main([*words, '-o', str(tmp_path / 'made.npz')]) == 0
    given = [row[3] for row in rows]
    for row, force in zip(rows, reversed(given), strict=True):
        row[3] = force
    written(made, [['rest.png', '', '', '0', ''], *rows])
    assert main([*words, '-o', str(tmp_path / 'mixed.npz')]) == 1
    assert 'do not move more when the given force is larger' in capsys.readouterr().err


def appended(*rows: Row) -> Change:
    return lambda known: known.extend(rows)


def test_one_picture_that_is_stated_twice_is_refused_with_both_lines(folder: Path, refused: Callable[..., str]) -> None:
    table = edited(folder, appended(['press2.png', '3.0', '-6.5', '1', 'ball:0.6']))
    said = 'edited.csv, line 18 has the image of line 8, but gives 0.00981 N at 3, -6.5 mm instead of '
    assert said in refused(imported, table)


def test_a_press_that_is_stated_to_be_the_untouched_gel_is_refused_with_both_lines(
    folder: Path, refused: Callable[..., str]
) -> None:
    def change(rows: list[Row]) -> None:
        rows[1][0] = 'press0.png'

    printed = refused(imported, edited(folder, change))
    assert re.search(r'line (6 has the image of line 3|3 has the image of line 6), but gives .*gel untouched', printed)


def test_one_picture_in_two_tables_is_named_unless_it_is_of_the_untouched_gel(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = rows_of(folder / 'presses.csv')
    other = written(folder / 'other.csv', [*rows[:RESTS], *rows[RESTS + 3 : RESTS + 6]])
    words = ['--model', str(folder / 'described.safetensors'), '-o', str(tmp_path / 'both.npz')]
    assert main(['dataset', 'import', str(folder / 'presses.csv'), str(other), *words]) == 0
    printed = ' '.join(capsys.readouterr().out.split())
    assert f'other.csv, line 6 has the image of line 9 of {folder / "presses.csv"} again; likewise 2 more' in printed
    assert 'has the image of line 2' not in printed


@pytest.mark.parametrize('command', [calibrated, imported])
def test_both_commands_refuse_rows_in_doubt_with_their_lines(
    command: Callable[..., int], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The pictures of two presses exchanged, one stated twice, and one put where a picture of the untouched gel was."""

    def change(rows: list[Row]) -> None:
        rows.append(rows[RESTS + 2])
        rows[RESTS][0], rows[RESTS + 1][0] = rows[RESTS + 1][0], rows[RESTS][0]
        rows[2][0] = rows.pop(RESTS + 4)[0]

    table, output = edited(folder, change), tmp_path / 'made'
    assert command(table, output) == 1
    shown = capsys.readouterr()
    error = ' '.join(shown.err.split())
    assert f'the image does not move at the given place in lines {RESTS + 2}, {RESTS + 3}: correct images or' in error
    assert 'the gel is said to be untouched, but the image moves as under a press, in line 4 (--force' in error
    assert 'edited.csv, line 17 has the image of line 8 again' in ' '.join(shown.out.split())
    assert not output.exists()


def test_two_exchanged_rows_are_found_wherever_they_are() -> None:
    """Sixteen presses, seen 20 mm apart from one side of the image to the other; each pair at least 6 mm apart."""
    place_mm = np.array([(x, y) for y in (-6, -2, 2, 6) for x in (-8, -3, 3, 8)], float)
    seen = 0.5 + place_mm / 20
    for pair in itertools.combinations(range(len(place_mm)), 2):
        if math.dist(*place_mm[list(pair)]) >= 6:
            exchanged_mm = place_mm.copy()
            exchanged_mm[list(pair)] = place_mm[list(reversed(pair))]
            assert aside(exchanged_mm, seen) == list(pair)


def test_rows_in_doubt_are_used_if_that_is_forced(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def change(rows: list[Row]) -> None:
        rows[RESTS][0], rows[RESTS + 1][0] = rows[RESTS + 1][0], rows[RESTS][0]

    assert imported(edited(folder, change), tmp_path / 'forced.npz', '--force') == 0
    printed = ' '.join(capsys.readouterr().out.split())
    assert f'used because of --force: the image does not move at the given place in lines {RESTS + 2}, ' in printed


def test_a_place_beside_what_the_camera_sees_is_a_fault_of_its_line(tmp_path: Path) -> None:
    """A pinhole of 400 px sees 320 px at 20 mm from its pupil: 8 mm to each side, and less below the surface."""
    sensor = dataclasses.replace(
        SENSOR,
        image=ImageSettings(320, 240, 320, 240),
        camera=CameraDescription('pinhole', 290.0, (400.0, 400.0), (0.0,) * 5, (159.5, 119.5), (0.0, 0.0, -20.0)),
    )
    read = read_table(written(tmp_path / 'table.csv', [['a.png', x, '1', '5', ''] for x in ('6', '-9.5', '', '9.5')]))
    faults = read.faults
    require_seen(read.rows, sensor, faults)
    with pytest.raises(DatasetError, match=r'line 3: -9.5, 1 mm lies outside the view of the camera.*: line 5$'):
        faults.require_none()


def test_what_is_cut_and_another_tip_than_the_model_knows_are_reported(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`portable` is of 440x440 pixels and the paper's tip of 0.6 mm; these are twice as large as they were taken."""

    def change(rows: list[Row]) -> None:
        for row in rows[RESTS:]:
            row[4] = 'ball:5'

    table = written(tmp_path / 'edited.csv', rows_of(edited(folder, change))[: RESTS + 4])  # which are too few to fit
    for file in folder.glob('*.png'):
        cv2.imwrite(str(tmp_path / file.name), cv2.resize(cv2.imread(str(file)), None, fx=2, fy=2))
    main(['calibrate', '--pictures', str(table), '--model', 'portable', '--gel', 'x', '-o', str(tmp_path / 'mine')])
    printed = ' '.join(capsys.readouterr().out.split())
    assert 'the images have 640x480 pixels, of which the middle 440x440 are used' in printed
    assert 'ball:5 pressed, but model' in printed and 'was trained with ball:0.6: a blunter tip reads' in printed
