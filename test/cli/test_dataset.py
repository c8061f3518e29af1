"""`tactile dataset`, `train --dataset` and `evaluate --dataset`, as a person runs them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from press_bags import Collection, Sensor, whole_collection

from tactile_nodes.cli.main import main
from tactile_nodes.learning.datasets.file import load_dataset
from tactile_nodes.model_file import load_model, save_model

COARSE = ['--profile', 'quick']
pytestmark = pytest.mark.usefixtures('own_cache')


@pytest.fixture(scope='module')
def sensor() -> Sensor:
    return Sensor()


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory, sensor: Sensor) -> Path:
    return whole_collection(tmp_path_factory.mktemp('bags') / 'collected', sensor)


@pytest.fixture(scope='module')
def file(bag: Path, tmp_path_factory: pytest.TempPathFactory, own_cache: Path) -> Path:
    path = tmp_path_factory.mktemp('files') / 'presses.npz'
    assert main(['dataset', 'build', str(bag), '-o', str(path), *COARSE, '--gel', 'gel-7']) == 0
    return path


def test_build_tells_what_it_made_and_what_it_left_out(
    tmp_path: Path, sensor: Sensor, capsys: pytest.CaptureFixture[str]
) -> None:
    collection = Collection(tmp_path / 'odd', sensor)
    collection.reference(0)
    collection.press(0, 1, 0.0, 0.0, 0.5)
    collection.press(1, 2, 0.0, 0.0, 1.0, frames=1)
    made = str(tmp_path / 'odd.npz')
    assert main(['dataset', 'build', str(collection.close()), '-o', made, *COARSE]) == 0
    shown = capsys.readouterr().out
    assert '1: 1 of 1 presses' in shown
    assert '1  lost frames           e.g. press 2: 1 images are in the bag, but 3 were taken' in shown
    assert f'tactile dataset info {made} --left-out' in shown
    assert main(['dataset', 'info', made, '--left-out']) == 0
    assert 'odd  2      1        lost frames' in capsys.readouterr().out


def test_info_tells_the_reading_of_the_labels(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['dataset', 'info', str(file)]) == 0
    shown = capsys.readouterr().out
    assert '9x9 bins of 3.556x3.556 mm over 32x32 mm' in shown
    assert 'gel-7' in shown


def test_a_run_of_ones_own_says_how_pictures_are_measured(bag: Path, tmp_path: Path) -> None:
    run, made = tmp_path / 'mine.yaml', tmp_path / 'mine.npz'
    run.write_text(
        'flow: {name: dis, options: {preset: fast}}\nencoding: {name: cartesian_mean, options: {rows: 8, cols: 10}}\n'
        'data: {crop: 400}\nnetwork: {rows: 5, cols: 7}\n'
    )
    assert main(['dataset', 'build', str(bag), '-o', str(made), '--profile', str(run)]) == 0
    presses = load_dataset(made)
    assert presses.features.shape[1:] == (8, 10, 2)
    assert (presses.bins.rows, presses.bins.cols) == (5, 7)
    assert presses.rest_image.shape == (400, 400)
    assert presses.card['flow']['options']['preset'] == 'fast'


def test_pictures_of_another_size_than_described_make_no_data_set(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / 'presses.npz'
    assert main(['dataset', 'build', str(bag), '-o', str(output), '--sensor', 'speckle_membrane']) == 1
    assert 'pixels, but the sensor is described with 640x480' in capsys.readouterr().err
    assert not output.exists()


@pytest.mark.parametrize('option', ['--model', '--sensor', '--profile', '--gel'])
@pytest.mark.parametrize('verb', ['build', 'import'])
def test_what_says_how_to_measure_is_not_replaced(
    verb: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / 'mine.yaml'
    mine.write_text('name: mine\n')
    assert main(['dataset', verb, str(tmp_path / 'presses'), option, str(mine), '-o', str(mine)]) == 1
    assert f'{mine} is read for it; choose another file' in capsys.readouterr().err
    assert mine.read_text() == 'name: mine\n'


def test_info_draws(file: Path, tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    assert main(['dataset', 'info', str(file), '--picture', str(tmp_path / 'p.png')]) == 0
    assert (tmp_path / 'p.png').stat().st_size > 10_000


def test_without_matplotlib_the_extra_to_install_is_named(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ('matplotlib', 'matplotlib.figure', 'matplotlib.backends.backend_agg'):
        monkeypatch.setitem(sys.modules, name, None)
    assert main(['dataset', 'info', str(file), '--picture', str(tmp_path / 'p.png')]) == 1
    assert "pip install 'tactile_nodes[train]'" in capsys.readouterr().err


def test_an_unknown_kind_of_picture_is_refused(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('matplotlib')
    assert main(['dataset', 'info', str(file), '--picture', str(tmp_path / 'p.nonsense')]) == 1
    assert 'cannot draw' in capsys.readouterr().err


def test_a_damaged_file_is_one_sentence(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / 'cut.npz').write_bytes(file.read_bytes()[:5000])
    assert main(['dataset', 'info', str(tmp_path / 'cut.npz')]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        (['--profile', 'none.yaml'], 'none.yaml'),
        (['--profile', 'paper', '--model', 'fast'], '--profile cannot be used with --model'),
        (['--without-contact', '2'], 'must be between 0 and 0.5'),
        (['--gel', 'none.yaml'], 'cannot read none.yaml'),
    ],
)
def test_an_option_that_cannot_be_used_is_one_sentence(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], sentence: str
) -> None:
    assert main(['dataset', 'build', str(bag), '-o', str(tmp_path / 'x.npz'), *words]) == 1
    shown = capsys.readouterr().err
    assert sentence in shown
    assert len(shown.splitlines()) == 1


def test_train_and_evaluate_take_the_file(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('torch')
    run = tmp_path / 'run.yaml'
    run.write_text(
        'network: {hidden: [8], dropout: 0.0}\ntraining: {batch: 5, epochs: 2, threads: 1, validation: 0.2}\n'
    )
    model = str(tmp_path / 'model.safetensors')
    # Two epochs with six presses make no model that anybody would want.
    words = ['train', str(run), '--dataset', str(file), '--split', 'position', '-o', model, '--force']
    assert main(words) == 0
    assert main(['evaluate', model, '--dataset', str(file), '--split', 'position']) == 0
    said = capsys.readouterr().out
    assert 'samples put aside by position' in said
    assert 'other markers' not in said
    loaded = load_model(model)
    save_model(Path(model), loaded.model, loaded.card, loaded.rest_image[::-1])
    assert main(['evaluate', model, '--dataset', str(file), '--split', 'position']) == 0
    assert 'shows other markers than that of the model: another gel' in capsys.readouterr().out


def test_a_split_without_a_file_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['evaluate', 'paper', '--split', 'position']) == 1
    assert '--dataset FILE' in capsys.readouterr().err
