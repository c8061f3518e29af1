"""``tactile dataset import`` and `import_arrays`: pictures of a simulated gel, and tables that tell of them."""

from __future__ import annotations

import shutil
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from tactile_nodes.cli.main import main
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import DatasetError, ModelError
from tactile_nodes.learning.config import load_train_config
from tactile_nodes.learning.datasets import picture
from tactile_nodes.learning.datasets.file import load_dataset
from tactile_nodes.learning.imported.arrays import import_arrays, options_of
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.feature_cache import FeatureCache, Measured
from tactile_nodes.learning.run.folder import run_id
from tactile_nodes.learning.training.source import evaluation_samples, recorded_data, with_file
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

HEADER = ['picture', 'x_mm', 'y_mm', 'force_n', 'indenter']
RESTS = 4
PX_PER_MM = 290 / 20  # in the middle: 290 px per radian, and markers 17 to 23 mm from the pupil
DESCRIPTION = 'image: {width: 640, height: 480, crop: 600, crop_height: 440}\nbins: {rows: 7, cols: 9}\n'
Row = list[str]

pytestmark = pytest.mark.usefixtures('own_cache')


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four pictures of an untouched gel, and a grid of twelve presses by two tips; and a description of the sensor."""
    made, gel = tmp_path_factory.mktemp('pictures'), Gel()
    table = contact_table(gel)
    optics = Optics(gel, table)
    (made / 'sensor.yaml').write_text(DESCRIPTION)
    for number in range(RESTS):
        cv2.imwrite(str(made / f'rest{number}.png'), optics.render((), number))
    rows = [[f'rest{number}.png', '', '', '0', ''] for number in range(RESTS)]
    for number, (x, y) in enumerate((x, y) for y in (-5.0, 0.0, 5.0) for x in (-8.0, -3.0, 3.0, 8.0)):
        depth = 0.4 + 0.05 * (7 * number % 12)
        cv2.imwrite(str(made / f'press{number}.png'), optics.render((Press(x, y, depth),), 100 + number))
        tip = 'first' if number % 2 else 'second'
        rows.append([f'press{number}.png', str(x), str(y), f'{table.force_at(depth):.4f}', tip])
    written(made / 'presses.csv', rows)
    return made


@pytest.fixture(scope='module')
def data_set(folder: Path, own_cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What all pictures and their table become."""
    made = tmp_path_factory.mktemp('made') / 'presses.npz'
    assert imported(folder / 'presses.csv', made) == 0
    return made


def written(table: Path, rows: list[Row], header: Row = HEADER) -> Path:
    table.write_text('\n'.join(','.join(row) for row in [header, *rows]) + '\n')
    return table


def rows_of(folder: Path) -> list[Row]:
    return [line.split(',') for line in (folder / 'presses.csv').read_text().splitlines()[1:]]


def imported(table: Path, output: Path, *words: str) -> int:
    sensor = ['--sensor', str(table.parent / 'sensor.yaml')]
    return main(['dataset', 'import', str(table), '-o', str(output), *sensor, *words])


@pytest.fixture
def refused(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """With which words the pictures in the folder and a table of these rows are refused."""

    def words_of(rows: list[Row], *words: str, header: Row = HEADER) -> str:
        table, output = written(folder / 'wrong.csv', rows, header), tmp_path / 'presses.npz'
        output.write_bytes(b'of yesterday')
        assert imported(table, output, *words) == 1
        assert output.read_bytes() == b'of yesterday'
        message = capsys.readouterr().err
        assert len(message.splitlines()) == 1
        return message

    return words_of


@pytest.mark.parametrize('moved_mm', [0.003, 0.05])
def test_a_camera_that_moves_between_presses_moves_no_feature(
    folder: Path, data_set: Path, tmp_path: Path, moved_mm: float
) -> None:
    """By 0.04 or 0.7 px, after the first press; each later one has an image of the untouched gel before it."""
    gel = replace(Gel(), camera_shift_mm=(moved_mm, 0.0))
    optics, table = Optics(gel, contact_table(gel)), contact_table(gel)
    rows = rows_of(folder)
    moved = rows[: RESTS + 1]
    for name in ['sensor.yaml', *(row[0] for row in moved)]:
        shutil.copy(folder / name, tmp_path)
    for number, row in enumerate(rows[RESTS + 1 :], 1):
        cv2.imwrite(str(tmp_path / f'before{number}.png'), optics.render((), 200 + number))
        press = Press(float(row[1]), float(row[2]), table.depth_at(float(row[3])))
        cv2.imwrite(str(tmp_path / row[0]), optics.render((press,), 100 + number))
        moved += [[f'before{number}.png', '', '', '0', ''], row]
    assert imported(written(tmp_path / 'presses.csv', moved), tmp_path / 'moved.npz') == 0
    found, still = load_dataset(tmp_path / 'moved.npz'), load_dataset(data_set)
    off = (found.features[found.contact] - still.features[still.contact]).astype(float)
    known = still.confidence[still.confidence_row[still.contact]] > 0.5
    assert np.abs(np.median(off[known], axis=0)).max() < 0.05 * moved_mm * PX_PER_MM


def test_pictures_of_a_sensor_that_is_not_square_become_a_data_set(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(folder / 'presses.csv', tmp_path / 'presses.npz', '--gel', 'mine') == 0
    presses = load_dataset(tmp_path / 'presses.npz')
    rows = rows_of(folder)[RESTS:]
    assert presses.force_n[presses.contact] == pytest.approx([float(row[3]) for row in rows])
    assert presses.position_mm[presses.contact].tolist() == [[float(row[1]), float(row[2])] for row in rows]
    assert (~presses.contact).sum() == RESTS
    assert np.isnan(presses.depth_mm[presses.contact]).all()
    samples = presses.as_samples()  # how deep nobody knows, and they are presses all the same
    assert samples.known.all() and ((samples.presses[:, 2] > 0) == presses.contact).all()
    assert [presses.card['indenters'][each] for each in presses.indenter[presses.contact]] == [row[4] for row in rows]
    assert presses.rest_image.shape == (440, 600)
    assert (presses.bins.rows, presses.bins.cols) == (7, 9)
    shown = capsys.readouterr().out
    assert 'first of each window, 600x440 px' in shown
    assert 'depths        not known' in shown


def test_pictures_of_a_press_whose_rows_are_apart_are_reported(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As in a table that was shuffled: a split would put them on both sides."""
    rows = rows_of(folder)
    assert imported(written(folder / 'apart.csv', [*rows, rows[-2]]), tmp_path / 'presses.npz') == 0
    shown = ' '.join(capsys.readouterr().out.split())
    assert 'apart.csv: presses with the values of an earlier one: 1. If they are pictures of one press' in shown
    assert imported(written(folder / 'together.csv', [*rows, rows[-1]]), tmp_path / 'presses.npz') == 0
    assert 'values of an earlier one' not in capsys.readouterr().out


def test_the_settings_that_a_run_writes_can_be_run_again(data_set: Path, tmp_path: Path) -> None:
    """Part of the image and bins follow from the data set: 600x440 pixels, and 7 rows of 9 bins."""
    written_run = tmp_path / 'run.yaml'
    presses, first = load_dataset(data_set), load_train_config(Path('config/train/recorded.yaml'))
    run = with_file(replace(first, data=replace(first.data, file=str(data_set))), presses)
    written_run.write_text(yaml.safe_dump(run.resolved()))
    again = with_file(load_train_config(written_run), presses)
    assert again.resolved() == run.resolved()
    assert again.data.crop == [600, 440]
    assert run_id(again, presses.fingerprint) == run_id(run, presses.fingerprint)


def test_presses_that_a_model_was_trained_on_are_not_scored_from_a_corrected_table(
    folder: Path, data_set: Path, tmp_path: Path
) -> None:
    """A table without one of its rows is another data set, of the same pictures."""
    corrected = tmp_path / 'corrected.npz'
    assert imported(written(folder / 'corrected.csv', rows_of(folder)[:-1]), corrected) == 0
    presses, config = load_dataset(data_set), load_train_config(Path('config/train/recorded.yaml'))
    data = recorded_data(replace(config, data=replace(config.data, file=str(data_set))), presses, Progress())
    assert data.origin['samples'] - data.origin['presses'] == RESTS
    model: Any = SimpleNamespace(
        model_id='this', card={'data': {**data.origin, 'fingerprint': presses.fingerprint}}, image_size=(600, 440),
        **{name: tuple(presses.card[name][each] for each in ('name', 'options')) for name in ('flow', 'encoding')},
    )  # fmt: skip
    with pytest.raises(ModelError, match='model this was trained with 11 of the 11 images of presses'):
        evaluation_samples(model, load_dataset(corrected), None)


def test_presses_of_one_of_several_indenters_are_chosen(folder: Path, data_set: Path) -> None:
    presses = load_dataset(data_set)
    first = presses.of_indenter('first')
    rows = [row for row in rows_of(folder) if row[4] == 'first']
    assert first.force_n[first.contact] == pytest.approx([float(row[3]) for row in rows])
    assert (~first.contact).sum() == RESTS
    assert len(first.as_samples().features) == len(rows) + RESTS
    assert first.fingerprint != presses.fingerprint
    with pytest.raises(DatasetError, match='holds presses of first, second, but one must be chosen: use --indent'):
        presses.of_indenter('')
    with pytest.raises(DatasetError, match="made with 'third'; it holds presses of first, second"):
        presses.of_indenter('third')


def edited(change: Callable[[list[Row]], object]) -> Callable[[Path], list[Row]]:
    def rows(folder: Path) -> list[Row]:
        made = rows_of(folder)
        change(made)
        return made

    return rows


def each(change: Callable[[Row], object]) -> Callable[[Path], list[Row]]:
    return edited(lambda rows: [change(row) for row in rows[RESTS:]])


def put(column: int, value: Callable[[str], str]) -> Callable[[Row], None]:
    def change(row: Row) -> None:
        row[column] = value(row[column])

    return change


@pytest.mark.parametrize(
    ('rows', 'said'),
    [
        (each(put(3, lambda _: '0.3')), 'has one force for all presses, 0.3 N: press with at least two weights'),
        (each(put(3, lambda n: str(1000 * float(n)))), 'N: forces must be below 200 N; check the unit'),
        (each(put(1, lambda _: '')), 'or noise of a gauge: --untouched-below N'),
        (edited(lambda rows: rows[6].__setitem__(0, 'gone.png')), 'line 8: cannot read the image'),
        (edited(lambda rows: rows.__delitem__(slice(RESTS))), 'has no image of the untouched gel'),
        (edited(lambda rows: rows.__delitem__(slice(RESTS, None))), 'has no press, all forces are 0'),
    ],
)  # fmt: skip
def test_a_table_that_contradicts_its_pictures_makes_no_data_set(
    rows: Callable[[Path], list[Row]], said: str, folder: Path, refused: Callable[..., str]
) -> None:
    assert said in refused(rows(folder))


def test_pictures_of_two_sizes_are_refused_with_their_line(folder: Path, refused: Callable[..., str]) -> None:
    small = cv2.imread(str(folder / 'press3.png'), cv2.IMREAD_GRAYSCALE)[:400]
    cv2.imwrite(str(folder / 'small.png'), small)
    rows = rows_of(folder)
    rows[RESTS + 3][0] = 'small.png'
    assert 'line 9: image small.png has 640x400 pixels, but the description' in refused(rows)


@pytest.mark.parametrize(
    ('row', 'grey', 'said'),
    [
        (1, 0, 'the camera image is black'),
        (RESTS + 3, 0, 'the camera image is black'),
        (RESTS + 3, 128, 'an image of the untouched gel does not show the pattern'),
    ],
)
def test_a_picture_that_shows_nothing_is_refused_with_its_line(
    row: int, grey: int, said: str, folder: Path, refused: Callable[..., str]
) -> None:
    cv2.imwrite(str(folder / 'nothing.png'), np.full((480, 640), grey, np.uint8))
    rows = rows_of(folder)
    if grey:
        rows.insert(row, ['nothing.png', '', '', '0', ''])
    rows[row][0] = 'nothing.png'
    assert f'line {row + 2}: {said}' in refused(rows)


def test_a_full_disk_is_no_fault_of_a_row(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(FeatureCache, 'get', lambda *_: None)
    monkeypatch.setattr(FeatureCache, 'put', full)
    assert imported(folder / 'presses.csv', tmp_path / 'x.npz') == 1
    assert capsys.readouterr().err.startswith('the disk is full')


def test_after_ctrl_c_the_same_command_continues_and_says_so(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    kept: list[bytes] = []
    put = FeatureCache.put

    def put_and_stop(cache: FeatureCache, key: bytes, measured: Measured) -> None:
        put(cache, key, measured)
        kept.append(key)
        if len(kept) == 9:
            raise KeyboardInterrupt

    monkeypatch.setattr(FeatureCache, 'put', put_and_stop)
    assert imported(folder / 'presses.csv', tmp_path / 'x.npz') == 130
    said = ' '.join(capsys.readouterr().out.split())
    assert 'stopped; finished measurements are kept, and the same command continues from there' in said
    assert imported(folder / 'presses.csv', tmp_path / 'x.npz') == 0
    assert len(kept) == len(set(kept)) > 9


def full(*_: object) -> None:
    raise DatasetError('the disk is full')


def test_that_only_the_middle_of_pictures_is_used_is_said_without_a_description(
    folder: Path, data_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said, table = 'of which the middle 440x440 are used', str(folder / 'presses.csv')
    for words, expected in (([], True), (['--sensor', str(folder / 'sensor.yaml')], False)):
        assert main(['dataset', 'import', table, '-o', str(tmp_path / 'x.npz'), *words]) == 0
        assert (said in ' '.join(capsys.readouterr().out.split())) is expected


def test_pictures_of_the_untouched_gel_are_in_memory_once(folder: Path, tmp_path: Path) -> None:
    """A hundred of 0.3 MB beside 130 MB of other things: they took ten times as much while their id was computed."""
    rows = rows_of(folder)
    table = written(folder / 'long.csv', [*[rows[0]] * 100, *rows])
    tracemalloc.start()
    try:
        assert imported(table, tmp_path / 'presses.npz') == 0
        assert tracemalloc.get_traced_memory()[1] < 220e6
    finally:
        tracemalloc.stop()


def test_pictures_that_no_row_names_are_counted(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As by a table that lost its last rows. A single one is a figure, which guided presses draw."""
    rows, own = rows_of(folder), tmp_path / 'pictures'
    own.mkdir()
    for name in ('sensor.yaml', *(row[0] for row in rows)):
        shutil.copy(folder / name, own)
    for missing in (1, 2):
        assert imported(written(own / 'short.csv', rows[:-missing]), tmp_path / 'short.npz') == 0
        printed = ' '.join(capsys.readouterr().out.split())
        assert (f'images that no row names: 2, such as {own / "press10.png"} and ' in printed) == (missing == 2)


@pytest.mark.parametrize(
    ('named', 'there'),
    [
        ('PRESS3.PNG', 'press3.png'),
        ('press3', 'press3.png'),
        ('press3.jpg', 'press3.png'),
        ('more\\press3.png', 'more/press3.png'),
        ('f\u00fcr.png', 'fu\u0308r.png'),
    ],
    ids=['capitals', 'no ending', 'another ending', 'backslash', 'umlaut of macOS'],
)
def test_the_picture_that_a_row_probably_means_is_named(
    named: str, there: str, folder: Path, refused: Callable[..., str]
) -> None:
    (folder / there).parent.mkdir(exist_ok=True)
    (folder / there).write_bytes((folder / 'press3.png').read_bytes())
    rows = rows_of(folder)
    rows[RESTS + 3][0] = named
    assert f'there is {folder / there}: write its name' in refused(rows)


def test_a_picture_that_cannot_be_looked_for_is_named_with_its_line(folder: Path, refused: Callable[..., str]) -> None:
    """The system refuses the name, as it refuses a folder beside the table that is closed to this user."""
    rows = rows_of(folder)
    rows[0][0] = name = 'x' * 300
    assert f'line 2: cannot read the image {folder / name} (File name too long)' in refused(rows)


@pytest.mark.parametrize(
    ('sensor', 'said'), [('printed_dots', '320x240'), ('speckle_membrane', 'of another camera or gel')]
)
def test_a_description_of_another_sensor_is_refused(
    sensor: str, said: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['dataset', 'import', str(folder / 'presses.csv'), '-o', str(tmp_path / 'x.npz'), '--sensor', sensor]
    assert main(words) == 1
    assert said in capsys.readouterr().err


def test_a_gel_without_markers_is_refused(folder: Path, refused: Callable[..., str]) -> None:
    rows = rows_of(folder)
    cv2.imwrite(str(folder / 'blank.png'), np.full((480, 640), 90, np.uint8))
    for row in rows[:RESTS]:
        row[0] = 'blank.png'
    assert 'the rest image shows markers in only 0% of its regions' in refused(rows)


def film(video: Path, pictures: list[Path]) -> Path:
    """Ten pictures a second."""
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*'FFV1'), 10.0, (640, 480), False)
    for file in pictures:
        writer.write(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))
    writer.release()
    return video


def test_moments_of_a_video_are_read_as_its_pictures(folder: Path, data_set: Path, tmp_path: Path) -> None:
    rows = rows_of(folder)
    video = film(tmp_path / 'video.avi', [folder / row[0] for row in rows])
    timed = [[f'{number / 10:.2f}', *row[1:]] for number, row in enumerate(rows)]
    table = written(folder / 'times.csv', timed[::-1], ['time_s', *HEADER[1:]])
    assert imported(table, tmp_path / 'video.npz', '--pictures', str(video)) == 0
    one, other = load_dataset(tmp_path / 'video.npz'), load_dataset(data_set)
    assert np.array_equal(one.features, other.features)


def test_a_time_after_the_end_of_the_video_is_reported(
    folder: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    video = film(tmp_path / 'short.avi', 3 * [folder / 'rest0.png'])
    timed = [['0.0', '', '', '0', ''], ['0.1', '1', '1', '0.2', ''], ['9.0', '2', '2', '0.3', '']]
    message = refused(timed, '--pictures', str(video), header=['time_s', *HEADER[1:]])
    assert 'line 4: time 9 s:' in message and 'ends at 0.3 s' in message


def test_arrays_of_another_project_are_the_same_presses(folder: Path) -> None:
    rows = rows_of(folder)
    images = np.stack([cv2.imread(str(folder / row[0]), cv2.IMREAD_COLOR) for row in rows])
    number = [[float(row[column] or 'nan') for row in rows] for column in (1, 2, 3)]
    x, y, force = (np.array(values) for values in number)
    shear = np.tile([0.1, -0.2], (len(rows), 1))
    made = import_arrays(
        images, x, y, force, options=options_of('fast', 'gel-7'), shear_n=shear, indenter=[row[4] for row in rows]
    )
    pressed = made.contact
    assert made.force_n[pressed] == pytest.approx(force[RESTS:])
    # As the wrenches of a rig are: force on the gel, z out of it.
    assert made.wrench[pressed][0, :3] == pytest.approx([0.1, -0.2, -force[RESTS]])
    assert made.card['gel']['id'] == 'gel-7'
    assert made.card['indenters'] == ['first', 'second']
    with pytest.raises(DatasetError, match=r'^theirs, row 5: force_n must not be negative'):
        wrong = np.where(np.arange(len(rows)) == 5, -1.0, force)
        import_arrays(images, x, y, wrong, options=options_of('fast'), name='theirs')


def test_consecutive_rows_of_arrays_with_equal_values_are_pictures_of_one_press(folder: Path) -> None:
    """Depth and shear are not given, so they are unknown in each row, which is no difference between two rows.

    Otherwise pictures of one press would be in the training and in the test set.
    """
    rows = [row for row in rows_of(folder)[RESTS:] for _ in range(2)]
    images = np.stack([cv2.imread(str(folder / name)) for name in ['rest0.png', *(row[0] for row in rows)]])
    x, y, force = (np.array([np.nan, *(float(row[column]) for row in rows)]) for column in (1, 2, 3))
    force[0] = 0.0
    made = import_arrays(images, x, y, force, options=options_of('fast', frames='each'))
    _, pictures = np.unique(made.press_number[made.contact], return_counts=True)
    assert pictures.tolist() == [2] * 12


def test_consecutive_rows_that_differ_in_a_torque_are_presses_of_their_own(folder: Path) -> None:
    """A tip that twists in place: position and force stay, only the torque about z differs."""
    rows = rows_of(folder)[RESTS:]
    names = ['rest0.png', rows[0][0], rows[0][0], rows[1][0]]
    images = np.stack([cv2.imread(str(folder / name)) for name in names])
    x, y, force = (
        np.array([rest, *(float(row[column]) for row in (rows[0], rows[0], rows[1]))])
        for rest, column in ((np.nan, 1), (np.nan, 2), (0.0, 3))
    )
    torque = np.full((4, 3), np.nan)
    torque[1:, 2] = 0.0, 0.005, 0.0
    made = import_arrays(images, x, y, force, options=options_of('fast'), torque_nm=torque, forced=True)
    assert made.wrench[made.contact][:, 5].tolist() == [0.0, 0.005, 0.0]


def test_a_wrong_picture_among_those_of_a_press_is_named_by_its_own_line(
    folder: Path, refused: Callable[..., str]
) -> None:
    """Three pictures of each press; the third ones of the first two presses are exchanged, 5 mm apart.

    They are in lines 8 and 11: one line of the header, four of the untouched gel, three of the first press.
    """
    rows = rows_of(folder)
    table = rows[:RESTS]
    for name, *values in rows[RESTS:]:
        image = cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
        for number in range(3):
            image[0, 0] = number  # a pixel beside the part that is used: another picture of the same press
            cv2.imwrite(str(folder / f'{number}_{name}'), image)
            table.append([f'{number}_{name}', *values])
    table[RESTS + 2][0], table[RESTS + 5][0] = table[RESTS + 5][0], table[RESTS + 2][0]
    assert 'does not move at the given place in lines 8, 11: correct images' in refused(table, '--frames', 'each')


def test_pictures_of_two_tables_must_have_one_size(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both are larger than the part that is used, in which a millimetre would have two sizes."""
    rows = rows_of(folder)
    for row in rows:
        large = cv2.resize(cv2.imread(str(folder / row[0]), cv2.IMREAD_GRAYSCALE), (800, 600))
        cv2.imwrite(str(folder / f'large_{row[0]}'), large)
    large_table = written(folder / 'large.csv', [[f'large_{row[0]}', *row[1:]] for row in rows])
    words = [str(folder / 'presses.csv'), str(large_table), '-o', str(tmp_path / 'x.npz')]
    assert main(['dataset', 'import', *words]) == 1
    message = capsys.readouterr().err
    assert 'large.csv, line 2: image large_rest0.png has 800x600 pixels' in message
    assert f'that of line 2 of {folder / "presses.csv"} has 640x480' in message


def test_bins_beside_the_middle_hold_places_up_to_their_own_rim(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twelve millimetres about x = 4 mm reach from -2 to 10 mm: 8 mm is on them, though more than half their width.

    The force of the first press, at x = 3 and y = -5 mm, belongs to row 0, column 1 of bins of 3 mm.
    """
    bins = 'bins: {rows: 4, cols: 4, width_mm: 12.0, height_mm: 12.0, centre_mm: [4.0, 0.0]}'
    (folder / 'beside.yaml').write_text(f'{DESCRIPTION.splitlines()[0]}\n{bins}\n')
    rows = [row for row in rows_of(folder) if row[3] == '0' or float(row[1]) > 0]
    words = ['-o', str(tmp_path / 'beside.npz'), '--sensor', str(folder / 'beside.yaml')]
    assert main(['dataset', 'import', str(written(folder / 'beside.csv', rows)), *words]) == 0
    presses = load_dataset(tmp_path / 'beside.npz')
    assert presses.position_mm[presses.contact, 0].tolist() == [3.0, 8.0] * 3
    assert presses.labels[presses.contact][0].argmax() == 1
    images = np.stack([cv2.imread(str(folder / row[0])) for row in rows])
    x, y, force = (np.array([float(row[column] or 'nan') for row in rows]) for column in (1, 2, 3))
    made = import_arrays(images, x, y, force, options=replace(options_of('fast'), bins=presses.bins))
    assert np.array_equal(made.labels, presses.labels)
    drawn = []
    monkeypatch.setattr(picture, 'save', lambda figure, _: drawn.append(figure))
    picture.draw(presses, tmp_path / 'beside.png')
    coverage, force_map = drawn[0].axes[0], drawn[0].axes[3]
    assert (coverage.get_xlim(), coverage.get_ylim()) == ((-2.0, 10.0), (6.0, -6.0))
    assert force_map.images[0].get_extent() == [-2.0, 10.0, 6.0, -6.0]
