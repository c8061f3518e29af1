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

pytestmark = pytest.mark.usefixtures('own_cache')


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


@pytest.mark.parametrize(
    ('words', 'refusal'),
    [
        (['--sensor', 'digit_like'], '--sensor is for bags'),
        (['--namespace', 'left'], '--namespace is for bags'),
        (['--gel', 'stiff.yaml'], '--gel is for bags; the gel to simulate stands in the run of --train'),
        (['bag', '--on', 'tcp://a:1'], '--on simulates presses on a cluster; it cannot be used with bags'),
        (['presses.npz'], 'presses.npz is a data set'),  # and holds no images
        (['--only', 'magic'], 'DIS medium, 20x20, 64'),
        (['no_bag', '-o', 'mine.onnx'], 'must end in .safetensors'),
    ],
)
def test_what_cannot_be_is_refused_before_the_hours_of_work(
    words: list[str], refusal: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['tune', '--max-ms', '1', '-o', str(tmp_path / 'm.safetensors'), *words]) == 1
    assert refusal in capsys.readouterr().err


@pytest.mark.parametrize('option', ['--train', '--sensor'])
def test_a_file_that_is_read_is_not_replaced(option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The profile's own run has the name of the model, with .yaml."""
    run = tmp_path / 'mine.yaml'
    run.write_text('seed: 3\n')
    words = ['tune', str(tmp_path / 'no_bag'), option, str(run), '--max-ms', '1']
    assert main([*words, '-o', str(tmp_path / 'mine.safetensors')]) == 1
    assert 'mine.yaml is read for it; choose another file' in capsys.readouterr().err
