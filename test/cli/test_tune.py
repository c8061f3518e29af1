"""`tactile tune`, as a person runs it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from press_bags import Sensor, spread_collection

from tactile_nodes.cli.main import main
from tactile_nodes.learning.config import load_train_config
from tactile_nodes.learning.datasets.file import load_dataset
from tactile_nodes.model_file import load_model


@pytest.fixture(scope='module', autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.mktemp('cache')))
        yield


def test_bags_become_a_profile_of_model_run_and_data_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, output = spread_collection(tmp_path / 'collected', Sensor(), 40), tmp_path / 'mine.safetensors'
    words = ['tune', str(bag), '--max-error', '1', '--only', 'quarter size, 10x10, 24', '--without-contact', '0.5']
    assert main([*words, '--gel', 'gel-7', '-o', str(output)]) == 0
    shown = capsys.readouterr().out
    assert '| ours at quarter size, 10x10, 24 |' in shown
    assert 'There is no smaller one on the front.' in shown
    model, run = load_model(output), load_train_config(output.with_suffix('.yaml'))
    assert model.flow == ('inverse_compositional', run.make_flow().options)
    assert model.gel == 'gel-7'
    assert run.data.file == str(output.with_suffix('.npz'))
    presses = load_dataset(run.data.file)
    assert presses.fingerprint == model.card['data']['fingerprint']
    assert model.rest_image.size and np.array_equal(model.rest_image, presses.rest_image)  # for the drift monitor


def test_a_described_sensor_gives_the_bins_and_the_part_of_the_pictures(tmp_path: Path) -> None:
    bag, output = spread_collection(tmp_path / 'collected', Sensor(), 40), tmp_path / 'mine.safetensors'
    (tmp_path / 'sensor.yaml').write_text(
        'image: {width: 440, height: 440, crop: 400, crop_height: 320}\n'
        'camera: {centre_px: [219.5, 219.5]}\n'
        'bins: {rows: 5, cols: 7}\n'
    )
    words = ['tune', str(bag), '--max-error', '1', '--only', 'quarter size, 10x10, 24', '--without-contact', '0.5']
    assert main([*words, '--sensor', str(tmp_path / 'sensor.yaml'), '-o', str(output)]) == 0
    model = load_model(output)
    assert (model.model.bins.rows, model.model.bins.cols, model.image_size) == (5, 7, (400, 320))
    assert load_dataset(output.with_suffix('.npz')).bins == model.model.bins


@pytest.mark.parametrize('given', [['--sensor', 'digit_like'], ['--namespace', 'left']])
def test_what_describes_bags_is_refused_without_bags(
    given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['tune', *given, '--max-ms', '1', '-o', str(tmp_path / 'm.safetensors')]) == 1
    assert f'{given[0]} is for bags' in capsys.readouterr().err


def test_a_cluster_is_refused_where_nothing_is_simulated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ['tune', str(tmp_path / 'bag'), '--on', 'tcp://127.0.0.1:1', '--max-ms', '1']
    assert main([*words, '-o', str(tmp_path / 'm.safetensors')]) == 1
    assert '--on simulates presses on a cluster; it cannot be used with bags' in capsys.readouterr().err


def test_a_data_set_is_refused_because_it_holds_no_images(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['tune', 'presses.npz', '--max-ms', '1', '-o', str(tmp_path / 'm.safetensors')]) == 1
    assert 'presses.npz is a data set' in capsys.readouterr().err


def test_a_gel_is_refused_where_presses_are_simulated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ['tune', '--gel', 'stiff.yaml', '--max-ms', '1', '-o', str(tmp_path / 'm.safetensors')]
    assert main(words) == 1
    assert '--gel is for bags; the gel to simulate stands in the run of --train' in capsys.readouterr().err


def test_a_configuration_that_does_not_exist_names_those_that_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['tune', '--only', 'magic', '--max-ms', '1', '-o', str(tmp_path / 'm.safetensors')]) == 1
    assert 'DIS medium, 20x20, 64' in capsys.readouterr().err


def test_a_name_that_is_not_of_a_model_is_refused_before_the_hours_of_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['tune', str(tmp_path / 'no_bag'), '--max-ms', '1', '-o', str(tmp_path / 'mine.onnx')]) == 1
    assert 'must end in .safetensors' in capsys.readouterr().err


@pytest.mark.parametrize('option', ['--train', '--sensor'])
def test_a_file_that_is_read_is_not_replaced(option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The profile's own run has the name of the model, with .yaml."""
    run = tmp_path / 'mine.yaml'
    run.write_text('seed: 3\n')
    words = ['tune', str(tmp_path / 'no_bag'), option, str(run), '--max-ms', '1']
    assert main([*words, '-o', str(tmp_path / 'mine.safetensors')]) == 1
    assert 'mine.yaml is read for it; choose another file' in capsys.readouterr().err
