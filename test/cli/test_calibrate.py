"""``tactile calibrate``: from a model and a file of presses to a model file that is like any other."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from body_presses import BodySensor
from press_bags import OTHER, spread_collection
from press_bags import Sensor as BagSensor

from tactile_nodes.cli.main import main
from tactile_nodes.errors import ModelError
from tactile_nodes.learning.axisymmetric.fit import fit_axisymmetric
from tactile_nodes.learning.config import AxisymmetricConfig
from tactile_nodes.learning.datasets.file import FORMAT, FORMAT_VERSION, save_dataset
from tactile_nodes.learning.datasets.labels import force_labels
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.body import body_of_card
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import load_model, save_model
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceModel
from tactile_nodes.sensing.explain.network import InputScaling, Mlp, NetworkReadout
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensors import BinSettings, load_sensor
from tactile_nodes.sensors.writing import text_of

ANY_CONTACT = ['--dataset', 'gel.npz', '--model', 'field']
FLOW = {'name': 'dis', 'options': {}}
ENCODING = {'name': 'cartesian_mean', 'options': {'rows': 6, 'cols': 6}}
REST_IMAGE = np.random.default_rng(9).integers(0, 255, (440, 440), np.uint8)


def field(places: np.ndarray, force: np.ndarray) -> np.ndarray:
    """A Gaussian motion around the tip, in 6x6 regions."""
    along = np.linspace(-11.0, 11.0, 6)
    away = np.stack(np.meshgrid(along, along), axis=-1)[None] - places[:, None, None]
    bell = np.exp(-(away**2).sum(axis=-1, keepdims=True) / 50)
    return np.asarray(force[:, None, None, None] * away * bell / 3)


def pressed(count: int, seed: int, softer: float, aside_mm: float) -> Dataset:
    """Presses, of which one in seven is none."""
    random = np.random.default_rng(seed)
    places, force = random.uniform(-9.0, 9.0, (count, 2)), random.uniform(0.1, 0.7, count)
    force[::7] = 0
    features = field(places + np.array([aside_mm, 0.0]), softer * force)
    features = features + 0.01 * random.normal(size=features.shape)
    rows = np.column_stack([places, np.where(force > 0, 2 * force, -1.0), force]).astype(np.float32)
    confidence = np.ones((1, 6, 6), np.float32)
    return Dataset(features.astype(np.float16), rows, np.zeros(count, int), confidence, 'pressed')


def recorded(dataset: Dataset, gel: str) -> RecordedPresses:
    count, bins = len(dataset.presses), BinGrid()
    place, depth, force = (each.astype(float) for each in np.split(dataset.presses, [2, 3], axis=1))
    numbers, unknown = np.arange(count), np.full(count, np.nan)
    bag = {'id': gel, 'gel': gel}
    labels = {'rows': 9, 'cols': 9, 'width_mm': 32.0, 'height_mm': 32.0, 'reading': '9x9 bins'}
    return RecordedPresses(
        features=dataset.features, labels=force_labels(place, force[:, 0], bins), confidence=dataset.confidence,
        confidence_row=np.zeros(count, np.int32), contact=depth[:, 0] > 0, position_mm=place,
        depth_mm=np.maximum(depth[:, 0], 0.0), depth_reported_mm=unknown, force_n=force[:, 0],
        force_rate_n_per_s=unknown, wrench=np.zeros((count, 6)), wrench_deviation=np.zeros((count, 6)),
        stamp_ns=numbers, window_ns=np.stack([numbers, numbers + 1], axis=1), frames=np.ones(count, np.int32),
        bag=np.zeros(count, np.int32), plan=np.zeros(count, np.int32), press=numbers,
        attempt=np.ones(count, np.int32), indenter=np.zeros(count, np.int32), quality=np.zeros(count, np.uint16),
        reference_id=np.full(count, 'r'), tare_id=np.full(count, 't'),
        card={
            'format': FORMAT, 'format_version': FORMAT_VERSION, 'left_out': [],
            'flow': FLOW, 'encoding': ENCODING, 'crop_px': 440, 'gel': {'id': gel}, 'bags': [bag], 'labels': labels,
            'frames': 'each', 'plans': ['p'], 'indenters': ['tip'],
        },
        rest_image=REST_IMAGE,
    )  # fmt: skip


@pytest.fixture(scope='module')
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    config = AxisymmetricConfig(lateral=1, vertical=1, turns=6, presses_per_turn=200, most_presses=600, most_contacts=1)
    dataset, bins = pressed(600, 1, 1.0, 0.0), BinGrid()
    readout = fit_axisymmetric(dataset, np.zeros(600, bool), config, bins, Progress())
    file = tmp_path_factory.mktemp('models') / 'first.safetensors'
    card = {'flow': FLOW, 'encoding': ENCODING, 'crop_px': 440, 'gel': {'id': 'first'}, 'data': {'origin': 'simulated'}}
    save_model(file, ForceModel(FeatureLayout('cartesian_mean', 6, 6, 2), bins, readout), card)
    return file


@pytest.fixture(scope='module')
def presses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp('presses') / 'second.npz'
    save_dataset(file, recorded(pressed(28, 2, 1.2, 0.7), 'second'))
    return file


@pytest.fixture(scope='module')
def calibrated(model: Path, presses: Path) -> Path:
    output = model.with_name('second.safetensors')
    assert main(['calibrate', '--model', str(model), '--dataset', str(presses), '-o', str(output)]) == 0
    return output


def test_the_file_is_a_model_that_names_gel_source_and_errors(model: Path, calibrated: Path) -> None:
    loaded = load_model(calibrated)
    assert loaded.gel == 'second'
    source = {'model': 'first.safetensors', 'model_id': load_model(model).model_id, 'gel': 'first'}
    assert loaded.card['source'] == source
    record = loaded.card['training']['calibration']
    assert record['presses'] == 24
    assert record['after']['force_rmse_n'] < record['before']['force_rmse_n']
    np.testing.assert_array_equal(loaded.rest_image, REST_IMAGE)  # that the gel is compared with later


def test_the_model_reads_the_new_gel(calibrated: Path) -> None:
    dataset = pressed(20, 3, 1.2, 0.7)
    readout = load_model(calibrated).model.readout
    found = [readout.read(each.astype(np.float32), dataset.confidence[0]).contacts[0] for each in dataset.features]
    touched = dataset.presses[:, 2] > 0
    off = np.array([(each.x_mm, each.y_mm) for each in found])[touched] - dataset.presses[touched, :2]
    assert np.median(np.hypot(*off.T)) < 0.15


def test_a_mounting_that_gives_way_is_said(model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each newton moves the picture by 0.4 px to the right."""
    dataset, file = pressed(28, 2, 1.2, 0.7), tmp_path / 'giving.npz'
    moved = 0.4 * np.maximum(dataset.presses[:, 3], 0.0)[:, None, None, None] * np.array([1.0, 0.0])
    giving = dataclasses.replace(dataset, features=(dataset.features + moved).astype(np.float16))
    save_dataset(file, recorded(giving, 'giving'))
    output = tmp_path / 'giving.safetensors'
    assert main(['calibrate', '--model', str(model), '--dataset', str(file), '-o', str(output)]) == 0
    (said,) = re.findall(
        'moves by at least ([0-9.]+) px per newton: the mounting of the camera gives way', capsys.readouterr().out
    )
    assert 0.3 < float(said) < 0.6
    assert load_model(output).card['training']['calibration']['gives_px'] == pytest.approx(float(said), rel=0.05)


def test_presses_that_made_the_model_do_not_judge_it(
    calibrated: Path, presses: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['evaluate', str(calibrated), '--dataset', str(presses)]) == 1
    assert 'was calibrated with presses of the same bags' in capsys.readouterr().err


def test_presses_that_made_the_model_of_a_calibration_do_not_judge_that_either(
    calibrated: Path, presses: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    others, output = tmp_path / 'third.npz', tmp_path / 'third.safetensors'
    save_dataset(others, recorded(pressed(28, 4, 1.4, -0.5), 'third'))
    assert main(['calibrate', '--model', str(calibrated), '--dataset', str(others), '-o', str(output)]) == 0
    assert main(['evaluate', str(output), '--dataset', str(presses)]) == 1
    assert 'was calibrated with presses of the same bags' in capsys.readouterr().err


def test_a_calibration_that_reads_no_better_is_written_only_if_forced(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    same, output = tmp_path / 'same.npz', tmp_path / 'same.safetensors'
    save_dataset(same, recorded(pressed(14, 5, 1.0, 0.0), 'same'))  # as the gel of the model itself
    words = ['calibrate', '--model', str(model), '--dataset', str(same), '-o', str(output)]
    assert main(words) == 1
    assert 'the calibration would not help: held-out presses are read' in capsys.readouterr().err
    assert not output.exists()
    assert main([*words, '--force']) == 0
    assert 'written because of --force: the calibration would not help' in capsys.readouterr().out
    assert 'would not help' in load_model(output).card['training']['calibration']['objection']


LETTER = Path(__file__).parents[2] / 'config' / 'transfer' / 'paper_letter.yaml'
PRESSES = ['--dataset', '{presses}']


@pytest.mark.parametrize(
    ('words', 'refusal'),
    [
        (
            ['--model', '{calibrated}', *PRESSES],
            'is already calibrated for gel second; to calibrate again start from its source model, first.s',
        ),
        (['--model', 'fast'], 'bags, --dataset FILE or --pictures CSV'),
        (['--model', 'paper', *PRESSES], 'build the data set with the options of the model (--model FILE)'),
        (
            ['--model', '{model}', *PRESSES, '--layer', str(LETTER)],
            "is not a network, but the paper's layer needs one",
        ),
        (
            # Other flows are distinguished by their names; options that both have alike are left out.
            ['--model', 'portable', *PRESSES],
            'was trained with flow inverse_compositional, but the data set was made with dis; build',
        ),
        # Options that would have no effect.
        (['--model', 'portable', *PRESSES, '--gel', 'gel-7'], '--gel does not go with --dataset'),
        (['--model', 'portable', *PRESSES, '--curve'], '--curve needs bags'),
        (['--model', 'portable', *PRESSES, '--namespace', 'left'], '--namespace needs bags'),
        # Only a model of any contact needs these.
        (['--dataset', 'gel.npz', '--model', 'portable', '--body', 'ball:5'], 'need a model of any contact'),
        ([*ANY_CONTACT, '--body', 'ball:-5'], 'ball:-5 is not a body: ball: must be followed by a'),
        ([*ANY_CONTACT, '--body', 'flat.stl'], 'cannot read the body flat.stl (No such'),
        ([*ANY_CONTACT, '--body', 'cube'], "there is no contact 'cube'; give one of: tip"),
        ([*ANY_CONTACT, '--body', 'punch:16'], 'mm wide, but the gel only 32 mm'),
        (['--model', 'portable', '--sensor', 'simulated'], 'a description gives a field'),
        (['--model', 'field', '--sensor', 'nowhere.yaml'], "there is no sensor 'nowhere.yaml'"),
        (['--model', 'field', '--sensor', 'simulated', '--touches', '5'], '5 touches are too few to learn from'),
        ([*ANY_CONTACT, '--touches', '100'], '--touches goes with --sensor alone'),
    ],
)
def test_what_does_not_go_together_is_refused_in_a_sentence(
    words: list[str], refusal: str, model: Path, presses: Path, calibrated: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    given = [word.format(model=model, presses=presses, calibrated=calibrated) for word in words]
    output = tmp_path / 'none.safetensors'
    assert main(['calibrate', *given, '-o', str(output)]) == 1
    assert refusal in capsys.readouterr().err
    assert not output.exists()


def test_an_open_mesh_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = tmp_path / 'sheet.obj'
    mesh.write_text('v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n')
    words = ['--model', 'field', '--dataset', 'gel.npz', '--body', str(mesh), '-o', str(tmp_path / 'none.safetensors')]
    assert main(['calibrate', *words]) == 1
    assert "the mesh 'sheet' is not closed: 3 of its edges do not join" in capsys.readouterr().err


@pytest.mark.timeout(240)  # a contact is solved, and fitted to, in seconds of a processor
def test_presses_of_a_square_calibrate_the_field_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], own_cache: Path
) -> None:
    """On 11x11 regions of a sensor with bins of 5.3 mm; the gel is half as hard again as its description says."""
    described, output = tmp_path / 'described.safetensors', tmp_path / 'gel-7.safetensors'
    sensor = dataclasses.replace(load_sensor('simulated'), name='coarse', bins=BinSettings(6, 6))
    (tmp_path / 'coarse.yaml').write_text(text_of(sensor, {}))
    words = ['--model', 'field', '--sensor', str(tmp_path / 'coarse.yaml'), '-o', str(described)]
    assert main(['calibrate', *words]) == 0
    gel = BodySensor('square', 2.0, cells=50, rows=4)
    bag = spread_collection(tmp_path / 'bag', gel, 10, 9.5, (0.1, float(gel.touched.depth_mm[-1])))
    words = ['--model', str(described), '--gel', 'gel-7', '--body', 'square', '--curve', '-o', str(output)]
    assert main(['calibrate', str(bag), *words]) == 0
    printed = capsys.readouterr().out
    assert 'force field alone: the model has no readout for tips' in printed
    none, some = (line for line in printed.splitlines() if ' presses: force RMSE' in line)
    assert none.strip().startswith('0 presses') and none.endswith('description')
    assert some.strip().startswith('8 presses')
    off_n = [float(line.split('RMSE ')[1].split(' N')[0]) for line in (none, some)]
    assert off_n[1] < off_n[0] / 3
    loaded = load_model(output)
    assert isinstance(loaded.model.readout, FieldReadout)
    assert (loaded.card['body'], 'ball_mm' in loaded.card) == ('square', False)


@pytest.mark.timeout(240)
def test_bags_of_presses_of_the_tip_calibrate_tips_and_field_without_a_data_set(
    first_field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], own_cache: Path
) -> None:
    """Five of them: the least that a calibration takes."""
    bag, output = spread_collection(tmp_path / 'bag', BagSensor(OTHER), 5), tmp_path / 'gel-7.safetensors'
    words = ['--model', str(first_field), '--gel', 'gel-7', '--curve', '-o', str(output)]
    assert main(['calibrate', str(bag), *words]) == 0
    printed = capsys.readouterr().out
    assert 'it reads held-out presses' in printed
    none, some = (line for line in printed.splitlines() if ' presses: force RMSE' in line)
    assert none.strip().startswith('0 presses') and none.endswith('description')
    assert some.strip().startswith('4 presses')
    loaded = load_model(output)
    assert (loaded.gel, loaded.card['data']['origin']) == ('gel-7', 'calibration')
    record = loaded.card['training']['calibration']
    assert record['presses'] == 5
    assert record['after']['force_rmse_n'] < record['before']['force_rmse_n']
    assert loaded.rest_image.shape == (440, 440)
    readout = loaded.model.readout
    assert isinstance(readout, FieldReadout)
    assert readout.tips is not None
    assert body_of_card(loaded.card, loaded.model_id).name == 'ball:0.6'


def test_a_source_that_was_pressed_by_a_mesh_asks_what_presses_now(model: Path) -> None:
    with pytest.raises(ModelError, match=r'with presses of part\.stl; give the body that presses now: --body ball:5'):
        body_of_card({'body': 'part.stl'}, load_model(model).model_id)


def test_a_description_alone_makes_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / 'mine.safetensors'
    assert main(['calibrate', '--model', 'field', '--sensor', 'simulated', '--gel', 'mine', '-o', str(output)]) == 0
    loaded = load_model(output)
    assert (loaded.gel, loaded.model.readout.kind) == ('mine', 'field')
    assert 'from the description simulated without presses' in capsys.readouterr().out
    with pytest.raises(ModelError, match='does not say which body pressed; give the body that presses now'):
        body_of_card(loaded.card, loaded.model_id)  # that of the shipped model pressed another gel


def test_a_network_gets_the_papers_layer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('torch')
    # So small a network is no better than answering the mean, and would not be written unless forced.
    assert main(['calibrate', *layered_words(tmp_path), '--force', '-o', str(tmp_path / 'new.safetensors')]) == 0
    loaded = load_model(tmp_path / 'new.safetensors')
    readout = loaded.model.readout
    assert isinstance(readout, NetworkReadout)
    assert readout.layer is not None
    assert loaded.gel == 'second'
    assert loaded.card['training']['calibration']['settings']['epochs'] == 20
    assert 'form layer: rectified units before the network' in capsys.readouterr().out


def layered_words(folder: Path) -> list[str]:
    """A model, a file of presses on a gel that shows half of the motion, and settings: all small."""
    source = NetworkReadout(
        InputScaling(np.zeros((6, 6, 2), np.float32), np.ones((6, 6, 2), np.float32), np.ones((6, 6), np.float32)),
        Mlp((np.full((81, 72), 0.002, np.float32) * np.tile([1, 0], 36).astype('f4'),), (np.zeros(81, np.float32),)),
        BinGrid(),
    )
    polar_means = {'name': 'polar_mean', 'options': {'rows': 6, 'cols': 6}}
    card = {'flow': FLOW, 'encoding': polar_means, 'crop_px': 440, 'gel': {'id': 'first'}, 'data': {}}
    save_model(folder / 'first.safetensors', ForceModel(FeatureLayout('polar_mean', 6, 6, 2), BinGrid(), source), card)
    dataset = pressed(120, 4, 0.5, 0.0)
    dx, dy = np.moveaxis(dataset.features.astype(float), -1, 0)
    polar = np.stack([np.hypot(dx, dy), np.arctan2(dy, dx) % (2 * np.pi)], axis=-1).astype(np.float16)
    file = recorded(dataclasses.replace(dataset, features=polar), 'second')
    save_dataset(folder / 'new.npz', dataclasses.replace(file, card={**file.card, 'encoding': polar_means}))
    (folder / 'layer.yaml').write_text('epochs: 20\nlearning_rate: 0.001\n')
    files = {'--model': 'first.safetensors', '--dataset': 'new.npz', '--layer': 'layer.yaml'}
    return [word for name, value in files.items() for word in (name, str(folder / value))]


@pytest.mark.parametrize(
    'words',
    [
        ['--dataset', '{presses}', '--model'],
        ['--model', 'field', '--pictures', 'presses.csv', '--sensor'],
        ['--model', 'field', '--pictures', 'presses.csv', '--body'],
    ],
)
def test_neither_the_model_to_begin_with_nor_a_description_nor_a_body_is_replaced(
    words: list[str], presses: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text('name: mine\n')
    given = [word.format(presses=presses) for word in words]
    assert main(['calibrate', *given, str(file), '-o', str(file)]) == 1
    assert f'{file} is read for it; choose another file' in capsys.readouterr().err
    assert file.read_text() == 'name: mine\n'


@pytest.mark.parametrize(
    'unused',
    [
        ['--body', 'ball:5'], ['--curve'], ['--force'], ['--indenter', 'ball:5'], ['--layer', 'layer.yaml'],
        ['--namespace', 'left'], ['--untouched-below', '0.1'],
    ],
    ids=' '.join,
)  # fmt: skip
def test_an_option_for_presses_is_refused_where_a_description_alone_makes_the_model(
    unused: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / 'mine.safetensors'
    assert main(['calibrate', '--model', 'field', '--sensor', 'simulated', '-o', str(output), *unused]) == 1
    assert f'{unused[0]} ' in (said := capsys.readouterr().err)
    assert 'leave it out' in said
    assert not output.exists()


def test_a_bag_that_was_cut_off_before_its_first_press_is_refused(
    other_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = next(other_bag.glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[:300_000])
    assert main(['calibrate', str(cut), '--model', 'portable', '-o', str(tmp_path / 'none')]) == 1
    printed = capsys.readouterr()
    assert f'{cut} is cut off at byte 300000' in printed.out
    assert printed.err == f'no press of {cut} can be used: there is none\n'


def test_presses_that_are_left_out_are_counted_with_their_reasons_and_so_are_problems_of_a_bag(
    first_model: Path, other_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], own_cache: Path
) -> None:
    """A copy of a bag holds the same attempts, except those in its damaged chunk."""
    whole = next(other_bag.glob('*.mcap')).read_bytes()
    middle, damaged = len(whole) // 2, tmp_path / 'damaged.mcap'
    damaged.write_bytes(whole[:middle] + bytes(100) + whole[middle + 100 :])
    words = ['--model', str(first_model), '--gel', 'gel-7', '-o', str(tmp_path / 'gel-7.safetensors')]
    assert main(['calibrate', str(other_bag), str(damaged), *words]) == 0
    printed = capsys.readouterr().out
    assert re.search(r'\nleft out: \d+ doubled \(the first: the same attempt was reported before\)\n', printed)
    assert re.search(r'damaged.mcap: the chunk at byte \d+ cannot be read \(its checksum is wrong\)', printed)


def test_a_calibration_is_on_the_list_of_gels_with_its_presses_and_errors(
    calibrated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    loaded = load_model(calibrated)
    capsys.readouterr()
    assert main(['gels', '--json']) == 0
    (found,) = [each for each in json.loads(capsys.readouterr().out) if each['model_id'] == loaded.model_id]
    assert (found['gel'], found['presses'], found['due']) == ('second', 24, '')
    assert found['error_n'] == loaded.card['training']['calibration']['after']['force_rmse_n']
    assert found['made_ns'] > 0
    assert main(['gels']) == 0
    (line,) = [each for each in capsys.readouterr().out.splitlines() if each.startswith(loaded.model_id)]
    assert 'second' in line
    assert 'not known' in line  # no drift monitor has seen it


def test_a_model_trained_on_recorded_presses_is_listed_with_their_number(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And not with that of the samples, which include those of the untouched gel."""
    loaded, file = load_model(calibrated), tmp_path / 'trained.safetensors'
    data = {'origin': 'recorded', 'samples': 100, 'presses': 60}
    model_id = save_model(file, loaded.model, {**loaded.card, 'data': data, 'training': {}})
    os.utime(file, ns=(0, 15 * 10**18))  # the year 2445, which no list can hold
    assert main(['gels', 'add', str(file)]) == 0
    capsys.readouterr()
    main(['gels', '--json'])
    (found,) = [each for each in json.loads(capsys.readouterr().out) if each['model_id'] == model_id]
    assert (found['presses'], found['made_ns']) == (60, 0)


def test_a_calibration_can_be_forgotten_and_added_again(
    calibrated: Path, model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model_id = load_model(calibrated).model_id
    assert main(['gels', 'forget', model_id]) == 0
    assert main(['gels', 'forget', model_id]) == 1
    assert main(['gels', 'add', str(calibrated), '--sensor', 'finger']) == 0
    assert main(['gels', 'add', str(model)]) == 1  # calibrated for nothing
    capsys.readouterr()
    main(['gels', '--json'])
    (found,) = [each for each in json.loads(capsys.readouterr().out) if each['model_id'] == model_id]
    assert (found['sensor'], found['presses']) == ('finger', 24)
