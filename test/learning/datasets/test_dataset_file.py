"""Files of data sets: they come back as they were, say what they are, and a damaged one is refused."""

from __future__ import annotations

import dataclasses
import json
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np
import pytest
from press_bags import SECOND_NS, START_NS, Collection, Sensor

from tactile_nodes import paths
from tactile_nodes.errors import ConfigurationError, DatasetError, ModelError
from tactile_nodes.learning.config import (
    Choice,
    DataConfig,
    FieldConfig,
    NetworkConfig,
    TrainConfig,
    TrainingConfig,
    load_train_config,
)
from tactile_nodes.learning.datasets import picture
from tactile_nodes.learning.datasets.file import load_dataset, save_dataset
from tactile_nodes.learning.datasets.recordings import RecordedPresses, fingerprint_of
from tactile_nodes.learning.datasets.report import report
from tactile_nodes.learning.evaluation import tables
from tactile_nodes.learning.evaluation.evaluate import evaluate_recorded
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.building import BuildOptions, build
from tactile_nodes.learning.training import source
from tactile_nodes.learning.training.source import evaluation_samples, training_data, with_file
from tactile_nodes.learning.training.train import train
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.rest.reference import content_id

pytestmark = pytest.mark.usefixtures('own_cache')

OPTIONS = BuildOptions(
    encoding=Choice('cartesian_mean', {'rows': 20, 'cols': 20}), without_contact=0.2, gel={'id': 'gel-7'}
)


@pytest.fixture(scope='module')
def presses(bag: Path, own_cache: Path) -> RecordedPresses:
    return build([bag], OPTIONS, command='tactile dataset build collected')


@pytest.fixture(scope='module')
def file(presses: RecordedPresses, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('files') / 'presses.npz'
    save_dataset(path, presses)
    return path


def test_a_part_of_the_samples_has_its_own_labels(presses: RecordedPresses) -> None:
    chosen, bins = np.array([4, 1, 6]), BinGrid()
    part, whole = presses.as_samples().take(chosen), presses.as_samples()
    np.testing.assert_array_equal(part.labels(bins), whole.labels(bins)[chosen])


def test_what_was_written_is_read(presses: RecordedPresses, file: Path) -> None:
    found = load_dataset(file)
    for name, array in presses.arrays().items():
        np.testing.assert_array_equal(getattr(found, name), array)
    assert dict(found.card) == dict(presses.card)
    assert found.fingerprint == presses.fingerprint


def test_the_same_presses_give_the_same_bytes(presses: RecordedPresses, file: Path, tmp_path: Path) -> None:
    save_dataset(tmp_path / 'again.npz', presses)
    assert (tmp_path / 'again.npz').read_bytes() == file.read_bytes()


def test_numpy_alone_opens_the_file_without_pickle(file: Path) -> None:
    with np.load(file, allow_pickle=False) as opened:
        card = json.loads(str(opened['card']))
        assert opened['labels'].shape == (15, 81)
    assert card['labels']['reading'].startswith('9x9 bins of 3.556x3.556 mm over 32x32 mm')
    assert card['bags'][0]['gel'] == 'gel-7'


def test_the_fingerprint_does_not_depend_on_how_the_file_came_about(presses: RecordedPresses) -> None:
    other = dataclasses.replace(presses, card={**presses.card, 'command': 'another', 'bag_names': ['elsewhere']})
    assert other.fingerprint == presses.fingerprint


def test_a_missing_file_is_reported_with_what_makes_one(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r'there is no data set .* with: tactile dataset build, or'):
        load_dataset(tmp_path / 'my presses.npz')


def test_damage_anywhere_is_noticed(file: Path, tmp_path: Path) -> None:
    """One bit in each of fifty places, through the whole file."""
    data = file.read_bytes()
    damaged = tmp_path / 'damaged.npz'
    for place in np.linspace(0, len(data) - 30, 50).astype(int).tolist():
        damaged.write_bytes(data[:place] + bytes([data[place] ^ 0x10]) + data[place + 1 :])
        try:
            found = load_dataset(damaged)
        except DatasetError:
            continue
        # Some bits of a zip archive mean nothing: dates, for instance.
        assert found.fingerprint == load_dataset(file).fingerprint


def plain_array() -> bytes:
    file = BytesIO()
    np.save(file, np.zeros(3))
    return file.getvalue()


@pytest.mark.parametrize(
    'content', [b'', b'PK\x03\x04 no archive', b'\x80\x04pickle', b'text' * 100, b'\x93NUMPY', plain_array()]
)
def test_what_is_no_data_set_is_refused_with_a_sentence(tmp_path: Path, content: bytes) -> None:
    (tmp_path / 'foreign.npz').write_bytes(content)
    with pytest.raises(DatasetError, match=r'foreign\.npz'):
        load_dataset(tmp_path / 'foreign.npz')


def test_a_table_or_a_bag_as_data_set_names_the_command_that_makes_one(tmp_path: Path) -> None:
    (tmp_path / 'presses.csv').write_text('picture,x_mm,y_mm,force_n\n')
    (tmp_path / 'bag').mkdir()
    for name in ('presses.csv', 'bag'):
        with pytest.raises(DatasetError, match='tactile dataset import') as refused:
            load_dataset(tmp_path / name)
        assert 'damaged' not in str(refused.value)


def test_ctrl_c_while_it_is_written_leaves_nothing_but_the_file_before(
    presses: RecordedPresses, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'presses.npz').write_bytes(file.read_bytes())

    def interrupt(_: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(paths, 'flush', interrupt)
    with pytest.raises(KeyboardInterrupt):
        save_dataset(tmp_path / 'presses.npz', presses)
    assert [each.name for each in tmp_path.iterdir()] == ['presses.npz']
    assert load_dataset(tmp_path / 'presses.npz').fingerprint == presses.fingerprint


def test_two_commands_may_write_one_file_at_once(
    presses: RecordedPresses, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = np.savez

    def beside_another(opened: BinaryIO, **arrays: np.ndarray) -> None:
        monkeypatch.setattr(np, 'savez', written)
        written(opened, **arrays)
        save_dataset(tmp_path / 'presses.npz', presses)

    monkeypatch.setattr(np, 'savez', beside_another)
    save_dataset(tmp_path / 'presses.npz', presses)
    assert load_dataset(tmp_path / 'presses.npz').fingerprint == presses.fingerprint


def test_values_changed_by_hand_are_noticed(file: Path, tmp_path: Path) -> None:
    with np.load(file, allow_pickle=False) as opened:
        arrays = {name: opened[name] for name in opened.files}
    np.savez(tmp_path / 'better.npz', **{**arrays, 'force_n': arrays['force_n'] * 2})
    with pytest.raises(DatasetError, match='its fingerprint is wrong'):
        load_dataset(tmp_path / 'better.npz')


def test_arrays_that_do_not_go_together_a_newer_format_and_a_file_cut_short_are_refused(
    presses: RecordedPresses, file: Path, tmp_path: Path
) -> None:
    save_dataset(tmp_path / 'odd.npz', dataclasses.replace(presses, confidence_row=presses.confidence_row + 9))
    save_dataset(tmp_path / 'new.npz', dataclasses.replace(presses, card={**presses.card, 'format_version': 3}))
    (tmp_path / 'cut.npz').write_bytes(file.read_bytes()[:-1000])
    for name, said in (('odd', 'damaged'), ('new', 'has version 3, but this release reads 1 to 2'), ('cut', 'damaged')):
        with pytest.raises(DatasetError, match=said):
            load_dataset(tmp_path / f'{name}.npz')


def test_the_report_tells_what_there_is(presses: RecordedPresses) -> None:
    text = report(presses)
    assert '15: 12 of 12 presses, 3 of the untouched gel' in text
    assert '0.5 mm (4), 1 mm (4), 1.5 mm (4)' in text
    assert 'gel-7' in text
    assert '20x20x2 of cartesian_mean from dis (preset ultrafast' in text


@pytest.mark.parametrize(('depth_mm', 'known'), [(1.5, True), (np.nan, False)])
def test_the_picture_names_a_depth_only_if_it_is_known(
    presses: RecordedPresses, monkeypatch: pytest.MonkeyPatch, depth_mm: float, known: bool
) -> None:
    """A table of presses by hand has no depths."""
    pytest.importorskip('matplotlib')
    drawn: list[Any] = []
    monkeypatch.setattr(picture, 'save', lambda figure, _: drawn.append(figure))
    picture.draw(dataclasses.replace(presses, depth_mm=np.full_like(presses.depth_mm, depth_mm)), Path('never.png'))
    words = [each.get_text() for each in drawn[0].findobj(match=lambda artist: hasattr(artist, 'get_text'))]
    assert any(' N at 1.5 mm' in text for text in words) == known
    assert any('no depth is known' in text for text in words) != known
    assert not any('nan' in text for text in words if 'label of press' in text)
    assert any('label of press' in text for text in words)


# --- training and evaluation ------------------------------------------------------------------------------


def run_config(folder: Path, file: Path, split: str = 'sample') -> TrainConfig:
    config = TrainConfig(
        output=folder / 'model.safetensors',
        network=NetworkConfig(hidden=(8,), dropout=0.0),
        training=TrainingConfig(batch=5, epochs=2, warm_up_epochs=1, threads=1, validation=0.2),
    )
    return dataclasses.replace(config, data=dataclasses.replace(config.data, file=str(file), split=split))


def test_the_file_decides_flow_features_and_bins(presses: RecordedPresses, file: Path, tmp_path: Path) -> None:
    config = with_file(run_config(tmp_path, file), presses)
    assert (config.encoding.name, config.encoding.options['rows']) == ('cartesian_mean', 20)
    assert config.bins == BinGrid()


def test_a_run_that_asks_for_other_features_is_refused(presses: RecordedPresses, file: Path, tmp_path: Path) -> None:
    (tmp_path / 'run.yaml').write_text(f'data: {{file: "{file}"}}\nencoding: {{name: polar_mean}}\n')
    with pytest.raises(ConfigurationError, match=r'asks for encoding .*polar_mean.* made with .*cartesian'):
        with_file(load_train_config(tmp_path / 'run.yaml'), presses)


def test_training_leaves_the_test_set_alone(file: Path, tmp_path: Path) -> None:
    """Three of twelve presses are put aside (a fifth, rounded up); of the nine left seven train."""
    data = training_data(run_config(tmp_path, file), Progress())
    touched = data.dataset.presses[:, 2] > 0
    assert (touched.sum(), (touched & ~data.held_out).sum()) == (9, 7)


def trained(folder: Path, file: Path, split: str) -> Path:
    """A model of all presses but those that are put aside."""
    pytest.importorskip('torch')
    return train(run_config(folder, file, split), forced=True)


@pytest.fixture(scope='module')
def model(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained(tmp_path_factory.mktemp('trained'), file, 'sample')


@pytest.mark.parametrize('split', ['sample', 'position'])
def test_a_model_of_recorded_presses_is_judged_by_what_was_put_aside(
    file: Path, model: Path, tmp_path: Path, split: str
) -> None:
    if split != 'sample':
        model = trained(tmp_path, file, split)
    card = load_model(model).card
    assert (card['data']['origin'], card['data']['split'], card['gel']) == ('recorded', split, {'id': 'gel-7'})
    assert card['data']['fingerprint'] == load_dataset(file).fingerprint
    scores = evaluate_recorded(model, file)
    assert scores.groups['all presses'].presses == 3
    assert f'put aside by {split}' in tables.report([scores])
    other = 'position' if split == 'sample' else 'sample'
    with pytest.raises(ModelError, match='it saw presses of the test set'):
        evaluate_recorded(model, file, split=other)


def test_another_file_of_the_same_bags_is_no_test(bag: Path, model: Path, tmp_path: Path) -> None:
    save_dataset(tmp_path / 'each.npz', build([bag], dataclasses.replace(OPTIONS, frames='each')))
    with pytest.raises(ModelError, match='presses of the same bags'):
        evaluate_recorded(model, tmp_path / 'each.npz')


def test_a_run_of_any_contact_names_the_presses_of_its_tips(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = TrainConfig(readout='field', data=DataConfig(file=str(file), split='position'))

    def origin(**tips: object) -> Any:
        monkeypatch.setattr(source, 'load_model', lambda _: SimpleNamespace(card={'data': tips}))
        return source.training_data(run, Progress()).origin

    alone = origin(origin='simulated')
    others = origin(origin='calibration', bags=['other'], pictures=['one'])
    assert (others['bags'], others['pictures']) == ([*alone['bags'], 'other'], ['one'])
    assert origin(**alone)['split_id'] == alone['split_id']  # trained with the same split
    with pytest.raises(ModelError, match='has seen presses that would be put aside'):
        origin(origin='calibration', bags=alone['bags'])
    run = dataclasses.replace(run, field=FieldConfig(body='ball:5'))
    with pytest.raises(DatasetError, match=r'pressed the gel, but field\.body of the run is ball:5'):
        origin(origin='simulated')


def test_bags_of_runs_that_ended_before_their_first_press_are_not_the_same_presses(
    model: Path, tmp_path: Path, sensor: Sensor
) -> None:
    others = Collection(tmp_path / 'others', sensor, start_ns=START_NS + 1000 * SECOND_NS)
    others.reference(0)
    others.press(0, 1, 0.0, 0.0, 0.5)
    recordings = build([Collection(tmp_path / 'ended', sensor).close(), others.close()], OPTIONS)
    ended, _ = recordings.card['bags']
    loaded = load_model(model)
    data = {**loaded.card['data'], 'bags': [*loaded.card['data']['bags'], ended['id']]}
    both = dataclasses.replace(loaded, card={**loaded.card, 'data': data})
    samples, _ = evaluation_samples(both, recordings, None)
    assert len(samples.presses) == len(recordings)


def test_a_model_of_other_features_is_refused(file: Path, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match='was trained with flow'):
        evaluate_recorded(find_model('fast'), file)


def test_a_data_set_holds_the_rest_image_that_its_presses_were_measured_against(presses: RecordedPresses) -> None:
    assert presses.rest_image.shape == (440, 440)
    assert content_id(presses.rest_image) in set(presses.reference_id)


def test_a_file_of_before_that_holds_gains_of_the_texture_is_read_without_them(
    presses: RecordedPresses, tmp_path: Path
) -> None:
    arrays = {**presses.arrays(), 'texture_gains': np.zeros(presses.rest_image.shape, np.float32)}
    card, file = json.dumps(dict(presses.card), sort_keys=True), tmp_path / 'presses.npz'
    np.savez(file, card=np.array(card), fingerprint=np.array(fingerprint_of(arrays, presses.card)), **arrays)
    assert load_dataset(file).fingerprint == presses.fingerprint


def test_a_file_of_before_there_were_rest_images_is_read(presses: RecordedPresses, tmp_path: Path) -> None:
    save_dataset(tmp_path / 'old.npz', dataclasses.replace(presses, rest_image=np.zeros((0, 0), np.uint8)))
    with np.load(tmp_path / 'old.npz') as opened:
        assert 'rest_image' not in opened.files
    assert load_dataset(tmp_path / 'old.npz').rest_image.size == 0
