"""``tactile calibrate --pictures``: pictures of weights and pens on a simulated gel, and a table that tells of them."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from coarse_table import linear_table

from tactile_nodes.cli.main import main
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.calibrating.hand_presses import HandPresses, outline_between
from tactile_nodes.learning.field.body import body_of_card
from tactile_nodes.learning.tables.columns import NEWTON_PER_GRAM
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensors import load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

GEL = Gel(seed=31, shear_modulus_mpa=0.09, camera_shift_mm=(1.0, -0.6))
HEADER = 'picture,x_mm,y_mm,grams'


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two pictures untouched, five weights and three pens."""
    made, table = tmp_path_factory.mktemp('pictures'), contact_table(GEL)
    optics, random = Optics(GEL, table), np.random.default_rng(3)
    rows = [HEADER]
    for number in range(2):
        cv2.imwrite(str(made / f'rest{number}.png'), optics.render((), number))
        rows.append(f'rest{number}.png,,,0')
    for number, (x, y) in enumerate(random.uniform(-11, 11, (8, 2)).tolist()):
        weight = number < 5
        depth = table.depth_at(50 * NEWTON_PER_GRAM) if weight else 0.6 + 0.2 * number
        cv2.imwrite(str(made / f'press{number}.png'), optics.render((Press(x, y, depth),), 10 + number))
        rows.append(f'press{number}.png,,,50' if weight else f'press{number}.png,{x:.3f},{y:.3f},')
    (made / 'gel.csv').write_text('\n'.join(rows) + '\n')
    (made / 'rest.csv').write_text('\n'.join(rows[:3]) + '\n')
    return made


def calibrated(folder: Path, table: str, model: str = 'portable', *more: str) -> Path:
    output = folder / f'{table}.safetensors'
    told = ['--model', model, '--gel', 'by-hand', '-o', str(output), *more]
    assert main(['calibrate', '--pictures', str(folder / table), *told]) == 0
    return output


def test_weights_and_pens_make_a_model_of_tips_alone_that_reads_its_gel(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    loaded = load_model(calibrated(folder, 'gel.csv', 'field'))
    said = ' '.join(capsys.readouterr().out.split())
    assert '5 weights at unknown places, 3 pens' in said
    assert 'force field not fitted, so this model reads tips alone: of 8 presses 0 have a place and a force' in said
    assert loaded.model.readout.kind == 'axisymmetric'
    told = loaded.card['training']['calibration']
    assert told['held'] == [] and told['outline'] is True
    # A modulus of 0.09 instead of 0.111 MPa: as deep with 0.81 of the force, so softer by ln(0.111 / 0.09) = 0.21.
    assert told['whole']['softness'] + told['whole']['lateral'] == pytest.approx(0.21, abs=0.12)
    assert loaded.rest_image.shape == (440, 440)


def test_pictures_that_calibrated_a_model_do_not_judge_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, presses = calibrated(folder, 'gel.csv'), folder / 'some.npz'
    rows = ['picture,x_mm,y_mm,force_n', 'rest0.png,,,0', 'rest1.png,,,0']  # written anew, with other numbers
    rows += [f'press{number}.png,{number},{-number},{0.4 + 0.1 * number}' for number in range(3)]
    (folder / 'some.csv').write_text('\n'.join(rows) + '\n')
    told = ['--model', str(model), '--gel', 'by-hand', '--force']
    assert main(['dataset', 'import', str(folder / 'some.csv'), '-o', str(presses), *told]) == 0
    capsys.readouterr()
    assert main(['evaluate', str(model), '--dataset', str(presses)]) == 1
    assert 'was calibrated with 3 of the 3 pictures of presses in this data set' in capsys.readouterr().err
    assert main(['evaluate', 'portable', '--dataset', str(presses)]) == 0


def test_pictures_beside_numbers_of_others_make_no_model(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random, rows = np.random.default_rng(7), ['image,x,y,Force [N]', 'rest0.png,,,0']
    for number, (x, y) in enumerate(random.uniform(-11, 11, (5, 2)).tolist()):
        rows.append(f'press{number}.png,{x:.2f},{y:.2f},{random.uniform(0.1, 0.9):.2f}')
    table, output = folder / 'mixed.csv', folder / 'mixed.safetensors'
    table.write_text('\n'.join(rows) + '\n')
    words = ['calibrate', '--pictures', str(table), '--model', 'portable', '--gel', 'mixed', '-o', str(output)]
    assert main(words) == 1
    said = capsys.readouterr()
    assert "force from 'Force [N]' in N" in ' '.join(said.out.split())
    assert 'the calibration would not pay' in said.err and 'check the table' in said.err
    assert not output.exists()


@pytest.mark.parametrize('model', ['portable', 'field'])
def test_a_table_without_any_press_makes_no_model(folder: Path, model: str, capsys: pytest.CaptureFixture[str]) -> None:
    output = folder / f'none-{model}.safetensors'
    words = ['--model', model, '--gel', 'by-hand', '-o', str(output)]
    assert main(['calibrate', '--pictures', str(folder / 'rest.csv'), *words]) == 1
    said = capsys.readouterr().err
    assert 'the table holds no press, all its forces are 0' in said
    assert said.count('\n') == 1
    assert not output.exists()


def test_two_rest_images_alone_make_a_model_if_forced_that_says_what_it_does_not_know(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    loaded = load_model(calibrated(folder, 'rest.csv', 'portable', '--force'))
    assert 'written by --force: the table holds no press' in capsys.readouterr().out
    told = loaded.card['training']['calibration']
    assert told['objection'].startswith('the table holds no press')
    assert told['form'] == 'outline'
    assert any('as hard as the known one' in sentence for sentence in told['held'])
    assert told['after']['force_rmse_n'] is None


def whole_presses(folder: Path, count: int) -> Path:
    """Presses of 0.1 to 0.5 N whose place and force are known, four pictures untouched, and five weights anywhere."""
    table, random = contact_table(GEL), np.random.default_rng(11)
    optics, rows = Optics(GEL, table), [HEADER]
    for number in range(4):
        cv2.imwrite(str(folder / f'still{number}.png'), optics.render((), 50 + number))
        rows.append(f'still{number}.png,,,0')
    for number, (x, y) in enumerate(random.uniform(-11, 11, (count, 2)).tolist()):
        force_n = float(random.uniform(0.1, 0.45))
        cv2.imwrite(
            str(folder / f'known{number}.png'), optics.render((Press(x, y, table.depth_at(force_n)),), 60 + number)
        )
        rows.append(f'known{number}.png,{x:.4f},{y:.4f},{force_n / NEWTON_PER_GRAM:.4f}')
    rows += [f'press{number}.png,,,50' for number in range(5)]
    (folder / f'known{count}.csv').write_text('\n'.join(rows) + '\n')
    return folder / f'known{count}.csv'


def test_presses_by_hand_that_are_known_whole_calibrate_the_field_too(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = folder / 'field.safetensors'
    words = ['--model', 'field', '--gel', 'by-hand', '-o', str(output)]
    assert main(['calibrate', '--pictures', str(whole_presses(folder, 16)), *words]) == 0
    told = ' '.join(capsys.readouterr().out.split())
    assert 'force field of 21 presses 16 have a place and a force that are known' in told
    loaded = load_model(output)
    readout, source = loaded.model.readout, load_model(find_model('field')).model.readout
    assert isinstance(readout, FieldReadout)
    assert isinstance(source, FieldReadout)
    assert readout.tips is not None
    # A modulus of 0.09 instead of 0.111 MPa: every force moves the regions by 1.23 times as much.
    assert np.linalg.norm(readout.response) / np.linalg.norm(source.response) == pytest.approx(0.111 / 0.09, rel=0.08)
    assert body_of_card(loaded.card, loaded.model_id).told == 'ball:0.6'


def test_rows_whose_indenter_is_no_body_are_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        'picture,x_mm,y_mm,grams,indenter',
        'rest0.png,,,0,',
        'press0.png,1,2,50,ball:0.6',
        'press1.png,1,2,50,bal:5',
    ]
    (folder / 'named.csv').write_text('\n'.join([*rows, rows[-1], 'press2.png,1,2,50,']) + '\n')
    words = [
        'calibrate',
        '--pictures',
        str(folder / 'named.csv'),
        '--model',
        'field',
        '-o',
        str(folder / 'n.safetensors'),
    ]
    assert main(words) == 1
    said = capsys.readouterr().err
    assert "named.csv, line 4: the indenter 'bal:5' is no body that is known: there is no contact 'bal:5'" in said
    assert '1 more cannot be used either: line 5' in said


def test_what_a_punch_shows_by_hand_needs_places_and_forces(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ['--model', 'field', '--body', 'punch:2', '--gel', 'by-hand', '-o', str(folder / 'none.safetensors')]
    assert main(['calibrate', '--pictures', str(folder / 'gel.csv'), *words]) == 1
    assert 'a calibration needs presses at 5 places at least, and there are 0' in capsys.readouterr().err


def test_why_pictures_of_another_size_cannot_be_compared_with_a_simulated_gel_is_told() -> None:
    told = outline_between(load_model(find_model('portable')), np.zeros((440, 440), np.uint8))
    assert told == 'the model has no rest image of its gel in 440x440 pixels, as the pictures are'


def test_the_outline_of_a_gel_whose_camera_is_aside_is_seen_aside(folder: Path) -> None:
    # In the middle 1 mm is 290 / 19.25 = 15 px at half the depth of the markers, and about half of that at the edges.
    found = outline_between(load_model(find_model('portable')), HandPresses.read(folder / 'rest.csv').rest_picture)
    assert not isinstance(found, str)
    assert -15.0 < found.shift_px[0] < -6.0
    assert 3.0 < found.shift_px[1] < 10.0


@pytest.mark.parametrize(
    ('lines', 'said'),
    [
        ([HEADER, 'press0.png,,,50'], 'no picture of the gel untouched'),
        ([HEADER, 'rest0.png,,,none'], 'must be a number'),
        ([HEADER, 'rest0.png,,,-5'], 'must not be negative'),
        ([HEADER, 'rest0.png,40,0,'], 'within 16 mm'),
        ([HEADER, ',,,0'], 'no picture is named'),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused(folder: Path, lines: list[str], said: str) -> None:
    table = folder / 'odd.csv'
    table.write_text('\n'.join(lines) + '\n')
    with pytest.raises(DatasetError, match=said):
        HandPresses.read(table)


def test_what_a_gauge_shows_of_nothing_is_no_press_where_that_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / 'gauge.csv').write_text('picture,x,y,force_n\nrest0.png,,,-0.08\nrest1.png,,,0.07\npress0.png,,,0.5\n')
    words = ['calibrate', '--pictures', str(folder / 'gauge.csv'), '--model', 'portable', '-o', str(folder / 'g.x')]
    assert main(words) == 1
    assert 'line 2: force_n must not be negative' in (told := capsys.readouterr().err) and '--untouched-below N' in told
    assert main([*words, '--untouched-below', '0.1']) == 1
    assert 'a calibration needs 5 presses at least, not 1' in capsys.readouterr().err


def test_a_number_left_empty_is_not_known(folder: Path) -> None:
    contacts = HandPresses.read(folder / 'gel.csv').contacts
    assert np.isnan(contacts[:5, :2]).all() and contacts[:5, 2] == pytest.approx(0.4905)
    assert np.isfinite(contacts[5:, :2]).all() and np.isnan(contacts[5:, 2]).all()


def test_a_file_that_is_no_table_is_refused_in_plain_words(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r'^cannot read .*none\.csv \(No such file or directory\); give a table'):
        HandPresses.read(tmp_path / 'none.csv')
    (tmp_path / 'binary.csv').write_bytes(b'\xfa\xfb')
    with pytest.raises(DatasetError, match='is no table of pictures; its first line names columns, as picture,x_mm'):
        HandPresses.read(tmp_path / 'binary.csv')


def test_pictures_may_lie_in_one_folder_beside_their_table(folder: Path, tmp_path: Path) -> None:
    table = tmp_path / 'rest.csv'
    table.write_text((folder / 'rest.csv').read_text())
    (tmp_path / 'other').mkdir()
    shutil.copytree(folder, tmp_path / 'pictures')
    beside, within = HandPresses.read(folder / 'rest.csv'), HandPresses.read(table)
    np.testing.assert_array_equal(within.rest_picture, beside.rest_picture)
    shutil.copytree(folder, tmp_path / 'again')
    with pytest.raises(DatasetError, match='cannot read the picture'):
        HandPresses.read(table)


def test_a_model_that_follows_a_texture_begins_with_no_printed_dots(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gel = dataclasses.replace(gel_of(load_sensor('printed_dots')), mechanics='linear')
    cv2.imwrite(str(tmp_path / 'rest.png'), Optics(gel, linear_table(gel)).render((), 1))
    (tmp_path / 'dots.csv').write_text('picture,x_mm,y_mm,grams\nrest.png,,,0\nrest.png,1,2,50\n')
    words = ['--model', 'portable', '--gel', 'dots', '-o', str(tmp_path / 'dots.safetensors')]
    assert main(['calibrate', '--pictures', str(tmp_path / 'dots.csv'), *words]) == 1
    assert 'printed dots' in capsys.readouterr().err


def test_a_sensor_with_other_bins_is_described_first(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = np.random.default_rng(3).uniform(-11, 11, (8, 2)).tolist()
    rows = [f'press{number}.png,{x:.3f},{y:.3f},50' for number, (x, y) in enumerate(places)]
    (folder / 'pressed.csv').write_text('\n'.join([HEADER, 'rest0.png,,,0', *rows]) + '\n')
    words = ['--model', 'field', '--sensor', 'printed_dots', '--gel', 'dots', '-o', str(folder / 'dots.safetensors')]
    assert main(['calibrate', '--pictures', str(folder / 'pressed.csv'), *words]) == 1
    said = capsys.readouterr().err
    assert '5x7 bins over 19x14.6 mm, and forces are told on 9x9 bins over 32x32 mm' in said
