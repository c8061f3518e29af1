from __future__ import annotations

import os
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from tiny_training import tiny_config, tiny_held_out, tiny_presses
from told import Told

from tactile_nodes.errors import ConfigurationError, ModelError
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.network import attempt as network_attempt
from tactile_nodes.learning.network import fit as network_fit
from tactile_nodes.learning.network.fit import fit_network
from tactile_nodes.learning.network.scores import Validation
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.run.folder import Run, RunFolder
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.geometry import BinGrid

pytestmark = pytest.mark.skipif(find_spec('torch') is None, reason='torch is not installed')

DULL = {'initial_weights': 'glorot', 'output_unit': 'newton', 'input_scaling': 'none'}


@pytest.fixture(autouse=True)
def without_novelty_check(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes longer than such a training, and has tests of its own."""
    monkeypatch.setattr(network_fit, 'with_novelty_check', lambda readout, *_: readout)


def fitted(config: TrainConfig, progress: Progress | None = None, run: Run | None = None):  # type: ignore[no-untyped-def]
    return fit_network(tiny_presses(), tiny_held_out(), config, progress or Progress(), run)


def fitted_in(runs: Path, config: TrainConfig, progress: Progress | None = None):  # type: ignore[no-untyped-def]
    with RunFolder(runs, config, 'tiny') as run:
        return fitted(config, progress, run)


def assert_same_numbers(one: NetworkReadout, other: NetworkReadout) -> None:
    for mine, theirs in zip(
        (*one.network.weights, *one.network.biases), (*other.network.weights, *other.network.biases), strict=True
    ):
        assert mine.tobytes() == theirs.tobytes()
    assert one.spread == other.spread


@pytest.mark.timeout(180)  # two processes import torch, on a machine that may be busy
def test_a_training_that_was_killed_goes_on_to_the_same_network(tmp_path: Path):
    """The process is killed somewhere after its sixth epoch; the next start ends as one that was never killed."""
    begun = subprocess.Popen(
        [sys.executable, str(Path(__file__).parents[1] / 'tiny_training.py'), str(tmp_path)],
        stdout=subprocess.PIPE, text=True, env={**os.environ, 'PYTHONPATH': str(Path(__file__).parents[3])},
    )  # fmt: skip
    assert begun.stdout is not None
    for _ in range(6):
        assert begun.stdout.readline() == 'epoch\n'
    begun.send_signal(signal.SIGKILL)
    begun.wait()
    begun.stdout.close()

    with RunFolder(tmp_path, tiny_config(), 'tiny') as run:
        reached = run.resume().counters.epoch  # type: ignore[union-attr]
    config = tiny_config(epochs=reached + 15)
    progress = Told()
    resumed, report = fitted_in(tmp_path, config, progress)
    whole, _ = fitted(config)
    assert reached >= 6
    assert progress.lines[0] == f'the run continues after epoch {reached}; --fresh trains it again'
    assert report['epochs_run'] == reached + 15
    assert_same_numbers(resumed, whole)


def test_an_interrupted_training_goes_on_through_a_restart_to_the_same_network(tmp_path: Path):
    config = tiny_config(DULL, learning_rate=1e-5, plateau_epochs=4, epochs=14)
    fitted_in(tmp_path, config, Told(ctrl_c_at=6))
    resumed, report = fitted_in(tmp_path, config, Told())
    whole, _ = fitted(config)
    assert report['restarts'] > 0
    assert_same_numbers(resumed, whole)


def test_a_run_that_is_over_is_not_trained_again(tmp_path: Path):
    config = tiny_config(epochs=3)
    first, _ = fitted_in(tmp_path, config)
    progress = Told(ctrl_c_at=1)
    again, report = fitted_in(tmp_path, config, progress)
    assert 'had ended (most epochs) after epoch 3' in progress.lines[0]
    assert report['ended'] == 'most epochs'
    assert_same_numbers(first, again)


def test_more_epochs_let_a_run_go_on(tmp_path: Path):
    for epochs in (3, 5):
        config = tiny_config(epochs=epochs)
        _, report = fitted_in(tmp_path, config)
        assert report['epochs_run'] == epochs


def test_a_seed_decides_the_network():
    (one, _), (same, _), (other, _) = (fitted(tiny_config(epochs=2, seed=seed)) for seed in (1, 1, 2))
    assert_same_numbers(one, same)
    assert one.network.weights[0].tobytes() != other.network.weights[0].tobytes()


def test_a_damaged_checkpoint_is_refused_with_what_to_do(tmp_path: Path):
    config = tiny_config(epochs=2)
    fitted_in(tmp_path, config)
    (file,) = tmp_path.glob('*/checkpoint.safetensors')
    file.write_bytes(file.read_bytes()[:-7])
    with pytest.raises(ModelError, match=r'checkpoint .* is damaged; train again .*--fresh'):
        fitted_in(tmp_path, config)


def test_ctrl_c_keeps_the_best_network_so_far():
    _, report = fitted(tiny_config(), Told(ctrl_c_at=4))
    assert report['epochs_run'] == 4
    assert report['ended'] == 'interrupted'


def test_a_network_on_the_all_zero_answer_is_begun_anew_and_that_is_reported():
    """With raw inputs and a small step the network says nothing; the restart does what is known to help."""
    progress = Told()
    config = tiny_config({**DULL, 'dropout': 0.0}, learning_rate=1e-3, loss='armse', warm_up_epochs=0,
                         plateau_epochs=3, epochs=60, patience=60)  # fmt: skip
    _, report = fitted(config, progress)
    assert report['restarts'] >= 1
    assert '3 epochs of the all-zero answer' in progress.lines[0]
    assert not report['predicts_nothing']


def test_a_network_may_wait_on_the_all_zero_answer_if_asked_to():
    """With a vanishing step it stays silent: 6 epochs pass although 3 without progress are the limit."""
    progress = Told()
    _, report = fitted(tiny_config(DULL, learning_rate=1e-9, epochs=6, patience=3, plateau='wait'), progress)
    assert (report['epochs_run'], report['restarts']) == (6, 0)
    assert report['predicts_nothing']
    assert 'predicts only zero' in progress.lines[-1]


def test_restarts_come_to_an_end():
    _, report = fitted(tiny_config(DULL, learning_rate=1e-9, epochs=9, plateau_epochs=1))
    assert report['restarts'] == network_fit.MOST_RESTARTS


def test_training_stops_when_the_loss_no_longer_falls(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Validation, 'silent', False)  # weights that never change say nothing, which is another matter
    _, report = fitted(tiny_config(learning_rate=0.0, epochs=50, patience=3))
    assert report['epochs_run'] == 4  # the best is the first
    assert report['ended'] == '3 epochs without a better validation loss'


def test_a_network_learns_where_presses_are():
    held_out = tiny_held_out(400)
    config = tiny_config({'hidden': (32,), 'dropout': 0.0}, loss='mse', learning_rate=5e-3, epochs=40)
    readout, _ = fit_network(tiny_presses(400), held_out, config, Progress())
    unseen = tiny_presses(100, seed=9)
    touched = unseen.presses[:, 3] > 0
    read = [readout.read(each.astype(np.float32), unseen.confidence[0]) for each in unseen.features]
    found = np.array([each.normal_force_n.argmax() for each in read])
    assert (found == unseen.labels(config.bins).argmax(axis=1))[touched].mean() > 0.8


def test_a_device_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr('torch.cuda.is_available', lambda: False)
    with pytest.raises(ConfigurationError, match='torch finds no CUDA device'):
        fitted(tiny_config(device='cuda'))


def test_cuda_finds_nearly_the_same_network():
    import torch

    if not torch.cuda.is_available():
        pytest.skip('no CUDA device')
    (here, _), (there, report) = (
        fitted(tiny_config({'dropout': 0.0}, epochs=2, device=device)) for device in ('cpu', 'cuda')
    )
    assert report['device'].startswith('cuda')
    # Other sums of the same numbers; the order of the samples is drawn on the processor either way.
    np.testing.assert_allclose(there.network.weights[0], here.network.weights[0], atol=1e-3)


def test_armse_in_torch_is_the_papers():
    import torch

    true, predicted = torch.tensor([[3.0, 0.0], [4.0, 0.0]]), torch.zeros(2, 2)
    assert network_attempt.armse(predicted, true).item() == pytest.approx(np.sqrt(12.5) / 2, rel=1e-5)


def test_a_network_that_says_nothing_is_noticed():
    true = np.zeros((5, 9), np.float32)
    true[:, 3] = 1.0
    bins = BinGrid(3, 3, 32.0, 32.0)
    assert Validation.of(true, 0.01 * true, bins).silent
    assert not Validation.of(true, 0.5 * true, bins).silent


def test_place_and_peak_are_asked_of_presses_alone():
    """One press right, one frame at rest with a little noise in another bin: nothing is misplaced."""
    true, predicted = np.zeros((2, 9), np.float32), np.zeros((2, 9), np.float32)
    true[0, 3] = predicted[0, 3] = 1.0
    predicted[1, 8] = 0.01
    scores = Validation.of(true, predicted, BinGrid(3, 3, 32.0, 32.0))
    assert (scores.d_loc_mm, scores.rmse_mc_n, scores.right_bin) == (0.0, 0.0, 1.0)
    assert scores.total_rmse_n == pytest.approx(0.01 / np.sqrt(2))


def test_the_step_shrinks_by_the_decay_each_epoch(tmp_path: Path):
    config = tiny_config(epochs=3, decay=0.5, learning_rate=0.008)
    fitted_in(tmp_path, config)
    (file,) = tmp_path.glob('*/metrics.jsonl')
    lines = file.read_text().splitlines()
    assert [line.split('"learning_rate": ')[1].split(',')[0] for line in lines] == ['0.008', '0.004', '0.002']


def test_a_restart_scales_warms_up_and_takes_another_seed():
    config = tiny_config(DULL, learning_rate=0.004)
    assert network_attempt.restarted(config, 0) is config
    third = network_attempt.restarted(config, 3)
    assert (third.network.input_scaling, third.network.initial_weights) == ('feature', 'balanced')
    assert third.training.seed != config.training.seed
    assert third.training.learning_rate == pytest.approx(0.001)
