"""``tactile calibrate --pictures``: pictures of weights on a simulated gel, and a table that tells of them."""

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
from tactile_nodes.learning.calibrating.hand_presses import presses_by_hand
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.field.body import body_of_card
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tables.columns import NEWTON_PER_GRAM
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensors import load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

GEL = Gel(seed=31, shear_modulus_mpa=0.09, camera_shift_mm=(1.0, -0.6))
HEADER = 'picture,x_mm,y_mm,grams'
RESTS, PRESSES = 9, 8

pytestmark = pytest.mark.usefixtures('own_cache')


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine pictures untouched, and eight weights of 10 to 46 g on marks."""
    made, table = tmp_path_factory.mktemp('pictures'), contact_table(GEL)
    optics, random = Optics(GEL, table), np.random.default_rng(11)
    rows = [HEADER]
    for number in range(RESTS):
        cv2.imwrite(str(made / f'rest{number}.png'), optics.render((), number))
        rows.append(f'rest{number}.png,,,0')
    for number, (x, y) in enumerate(random.uniform(-11, 11, (PRESSES, 2)).tolist()):
        force_n = float(random.uniform(0.1, 0.45))
        press = Press(x, y, table.depth_at(force_n))
        cv2.imwrite(str(made / f'press{number}.png'), optics.render((press,), 60 + number))
        rows.append(f'press{number}.png,{x:.4f},{y:.4f},{force_n / NEWTON_PER_GRAM:.4f}')
    (made / 'gel.csv').write_text('\n'.join(rows) + '\n')
    return made


@pytest.fixture(scope='module')
def portable(folder: Path) -> Path:
    """The model that calibrates the portable one with these pictures."""
    return calibrated(folder / 'gel.csv', find_model('portable'))


def calibrated(table: Path, model: Path, *more: str) -> Path:
    output = table.with_name(f'by_hand_{model.name}')
    options = ['--model', str(model), '--gel', 'by-hand', '-o', str(output), *more]
    assert main(['calibrate', '--pictures', str(table), *options]) == 0
    return output


def read(table: Path) -> RecordedPresses:
    return presses_by_hand(load_model(find_model('portable')), table, 'by-hand', Progress())


def test_weights_on_marks_tell_how_hard_the_gel_is(portable: Path) -> None:
    loaded = load_model(portable)
    entry = loaded.card['training']['calibration']
    assert entry['presses'] == PRESSES
    # A modulus of 0.09 instead of 0.111 MPa: as deep with 0.81 of the force, so softer by ln(0.111 / 0.09) = 0.21.
    assert entry['whole']['softness'] + entry['whole']['lateral'] == pytest.approx(0.21, abs=0.12)
    assert entry['after']['force_rmse_n'] < 0.3 * entry['before']['force_rmse_n']
    assert loaded.rest_image.shape == (440, 440)


def test_all_pictures_of_the_untouched_gel_count(folder: Path) -> None:
    assert int((~read(folder / 'gel.csv').contact).sum()) == RESTS > PRESSES


def test_pictures_that_calibrated_a_model_do_not_judge_it(
    folder: Path, portable: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    presses = folder / 'some.npz'
    rows = ['picture,x_mm,y_mm,force_n', 'rest0.png,,,0', 'rest1.png,,,0']  # written anew, with other numbers
    rows += [f'press{number}.png,{number},{-number},{0.4 + 0.1 * number}' for number in range(3)]
    (folder / 'some.csv').write_text('\n'.join(rows) + '\n')
    options = ['--model', str(portable), '--gel', 'by-hand', '--force']
    assert main(['dataset', 'import', str(folder / 'some.csv'), '-o', str(presses), *options]) == 0
    capsys.readouterr()
    assert main(['evaluate', str(portable), '--dataset', str(presses)]) == 1
    assert 'was calibrated with 3 of the 3 images of presses in this data set' in capsys.readouterr().err
    assert main(['evaluate', 'portable', '--dataset', str(presses)]) == 0


def test_pictures_beside_numbers_of_others_make_no_model(
    folder: Path, first_model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    random, rows = np.random.default_rng(7), ['image,x,y,Force [N]', 'rest0.png,,,0']
    for number, (x, y) in enumerate(random.uniform(-11, 11, (7, 2)).tolist()):
        rows.append(f'press{number}.png,{x:.2f},{y:.2f},{random.uniform(0.1, 0.9):.2f}')
    table, output = folder / 'mixed.csv', folder / 'mixed.safetensors'
    table.write_text('\n'.join(rows) + '\n')
    words = ['calibrate', '--pictures', str(table), '--model', str(first_model), '--gel', 'mixed', '-o', str(output)]
    assert main(words) == 1
    said = capsys.readouterr()
    assert "force from 'Force [N]' in N" in ' '.join(said.out.split())
    # Which of two checks refuses such numbers first is decided by rounding, that is by the processor.
    assert 'the calibration would not help' in said.err or 'when the gel shows none' in said.err
    assert 'check the given places and forces' in said.err
    assert not output.exists()


def test_weights_on_marks_calibrate_the_field_too(
    folder: Path, first_field: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    loaded = load_model(calibrated(folder / 'gel.csv', first_field, '--curve'))
    said = ' '.join(capsys.readouterr().out.split())
    assert 'it reads held-out presses' in said and f'from {PRESSES} presses' in said
    assert 'fitted to: 0 presses: force RMSE' in said
    readout, source = loaded.model.readout, load_model(first_field).model.readout
    assert isinstance(readout, FieldReadout)
    assert isinstance(source, FieldReadout)
    assert readout.tips is not None
    # A modulus of 0.09 instead of 0.111 MPa: every force moves the regions by 1.23 times as much.
    assert np.linalg.norm(readout.response) / np.linalg.norm(source.response) == pytest.approx(0.111 / 0.09, rel=0.08)
    assert body_of_card(loaded.card, loaded.model_id).name == 'ball:0.6'


def test_rows_whose_indenter_is_no_body_are_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f'{HEADER},indenter', 'rest0.png,,,0,', 'press0.png,1,2,50,ball:0.6', 'press1.png,1,2,50,bal:5']
    (folder / 'named.csv').write_text('\n'.join([*rows, rows[-1], 'press2.png,1,2,50,']) + '\n')
    words = ['calibrate', '--pictures', str(folder / 'named.csv'), '--model', 'field', '-o', str(folder / 'n.x')]
    assert main(words) == 1
    said = capsys.readouterr().err
    assert "named.csv, line 4: the indenter 'bal:5' is not a known body: there is no contact 'bal:5'" in said
    assert '1 more cannot be used either: line 5' in said


@pytest.mark.parametrize('chosen', [['ball:0.6'], ['pen', '--body', 'ball:2']])
def test_rows_of_an_indenter_that_is_not_chosen_need_no_body(
    folder: Path, chosen: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Each is one of two indenters of the table, and the chosen one has a shape: by its name, or by --body.

    Then only presses are missing, of which each indenter has two.
    """
    rows = [f'{HEADER},indenter', 'rest0.png,,,0,', 'press0.png,1,2,50,ball:0.6', 'press1.png,3,2,40,ball:0.6']
    rows += ['press2.png,1,2,50,pen', 'press3.png,3,2,40,pen']
    (folder / 'pens.csv').write_text('\n'.join(rows) + '\n')
    words = ['calibrate', '--pictures', str(folder / 'pens.csv'), '--model', 'field', '-o', str(folder / 'p.x')]
    assert main([*words, '--indenter', *chosen]) == 1
    said = capsys.readouterr().err
    assert 'is not a known body' not in said
    assert 'but there are 2' in said


@pytest.mark.parametrize(
    ('lines', 'said'),
    [
        ([HEADER, 'press0.png,1,2,50'], 'no image of the untouched gel'),
        ([HEADER, ',,,0'], 'no image is named'),
        ([HEADER, 'rest0.png,,,0'], 'has no press, all forces are 0'),
        ([HEADER, 'rest0.png,,,0', 'press0.png,,,50', 'press1.png,1,2,'], 'line 3: a press needs x, y and .* line 4'),
        (['time_s,x_mm,y_mm,grams', '0,,,0'], 'names no images; make a data set from a video'),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused(folder: Path, lines: list[str], said: str) -> None:
    table = folder / 'odd.csv'
    table.write_text('\n'.join(lines) + '\n')
    with pytest.raises(DatasetError, match=said):
        read(table)


def test_what_a_gauge_shows_of_nothing_is_no_press_where_that_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = ['picture,x,y,force_n', 'rest0.png,,,-0.08', 'rest1.png,,,0.07', 'press0.png,1,2,0.5', 'press1.png,3,2,0.6']
    (folder / 'gauge.csv').write_text('\n'.join(rows) + '\n')
    words = ['calibrate', '--pictures', str(folder / 'gauge.csv'), '--model', 'portable', '-o', str(folder / 'g.x')]
    assert main(words) == 1
    message = capsys.readouterr().err
    assert 'line 2: force_n must not be negative' in message and '--untouched-below N' in message
    assert main([*words, '--untouched-below', '0.1']) == 1
    assert 'a calibration needs presses at least at 5 places, but there are 2' in capsys.readouterr().err


def test_a_file_that_is_no_table_is_refused_in_plain_words(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r'^cannot read .*none\.csv \(No such file or directory\); give a table'):
        read(tmp_path / 'none.csv')
    (tmp_path / 'binary.csv').write_bytes(b'\xfa\xfb')
    with pytest.raises(DatasetError, match='not a table of images; its first line must name columns, as in picture'):
        read(tmp_path / 'binary.csv')


def test_pictures_may_lie_in_one_folder_beside_their_table(folder: Path, tmp_path: Path) -> None:
    table = tmp_path / 'gel.csv'
    table.write_text((folder / 'gel.csv').read_text())
    (tmp_path / 'other').mkdir()
    shutil.copytree(folder, tmp_path / 'pictures')
    np.testing.assert_array_equal(read(table).rest_image, read(folder / 'gel.csv').rest_image)
    shutil.copytree(folder, tmp_path / 'again')
    with pytest.raises(DatasetError, match='cannot read the image'):
        read(table)


def test_a_model_that_follows_a_texture_begins_with_no_printed_dots(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gel = dataclasses.replace(gel_of(load_sensor('printed_dots')), mechanics='linear')
    cv2.imwrite(str(tmp_path / 'rest.png'), Optics(gel, linear_table(gel)).render((), 1))
    rows = ['rest.png,,,0', 'rest.png,1,2,50', 'rest.png,3,2,20']
    (tmp_path / 'dots.csv').write_text('\n'.join([HEADER, *rows]) + '\n')
    words = ['--model', 'portable', '--gel', 'dots', '-o', str(tmp_path / 'dots.safetensors')]
    assert main(['calibrate', '--pictures', str(tmp_path / 'dots.csv'), *words]) == 1
    assert 'printed dots' in capsys.readouterr().err
    words = ['--sensor', 'printed_dots', '-o', str(tmp_path / 'dots.npz')]
    assert main(['dataset', 'import', str(tmp_path / 'dots.csv'), *words]) == 1
    assert 'printed dots' in capsys.readouterr().err


def test_a_sensor_with_other_bins_is_described_first(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ['--model', 'field', '--sensor', 'printed_dots', '--gel', 'dots', '-o', str(folder / 'dots.safetensors')]
    assert main(['calibrate', '--pictures', str(folder / 'gel.csv'), *words]) == 1
    said = capsys.readouterr().err
    assert '5x7 bins over 19x14.6 mm, but the model reports forces on 9x9 bins over 32x32 mm' in said
