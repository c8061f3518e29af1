"""Fit a network to presses: the paper's optimiser and stopping rule, and restarts from the all-zero answer.

A press puts force into one bin of 81, so predicting zero costs little, and logistic layers may stay at that answer
for tens of epochs or for ever. Epochs without an answer never count towards stopping. After `plateau_epochs` of them
training restarts with settings that help (`restarted`), and the person is informed.

The same configuration gives the same weights on the same processor, even if the training was killed in between.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_nodes import clock
from tactile_nodes.errors import ConfigurationError, TooFewPressesError
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.network.attempt import Attempt, restarted
from tactile_nodes.learning.network.calibration import calibrated
from tactile_nodes.learning.network.inputs import judging_samples, shown_samples
from tactile_nodes.learning.network.layers import as_mlp, import_torch
from tactile_nodes.learning.network.novelty_check_fit import with_novelty_check
from tactile_nodes.learning.network.scores import Validation
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.run import checkpoint
from tactile_nodes.learning.run.checkpoint import Counters, Snapshot
from tactile_nodes.learning.run.folder import Run
from tactile_nodes.sensing.explain.network import NetworkReadout

if TYPE_CHECKING:
    import torch

MOST_RESTARTS = 3


def fit_network(
    dataset: Dataset, held_out: np.ndarray, config: TrainConfig, progress: Progress, run: Run | None = None
) -> tuple[NetworkReadout, dict[str, Any]]:
    """The readout with its novelty check and its uncertainty, measured on held-out samples; and the card's entries.

    Ctrl-C ends the training and keeps the best network so far.

    Raises:
        ConfigurationError: torch is not installed, or not the device that the configuration asks for.
        ModelError: the run's checkpoint is damaged.
        TooFewPressesError: no press with a force is left to learn from.
    """
    import_torch()
    if not ((dataset.presses[:, 2] > 0) & (dataset.presses[:, 3] > 0))[~held_out].any():
        raise TooFewPressesError('a network needs presses with a force to train on, but there is none; record some')
    device = prepare_torch(config)
    training = Training.resumed(dataset, held_out, config, device, run or Run(), progress)
    try:
        training.run()
    except KeyboardInterrupt:
        training.say('stopped; keeping the best network so far (the same command continues)')
        training.counters.ended = 'interrupted'
    readout = training.readout()
    learned, judges = shown_samples(dataset, held_out, config), judging_samples(dataset, held_out, config)
    readout = calibrated(readout, dataset, learned, judges)
    return with_novelty_check(readout, dataset, held_out, config.encoding.name, progress), training.report()


def prepare_torch(config: TrainConfig) -> torch.device:
    """The device to train on; torch is set to give reproducible numbers.

    Raises:
        ConfigurationError: there is no CUDA though asked for.
    """
    import torch

    wanted, found = config.training.device, torch.cuda.is_available()
    if wanted == 'cuda' and not found:
        raise ConfigurationError(
            'training.device is cuda, but torch finds no CUDA device; use auto or cpu, or install a torch with CUDA'
        )
    os.environ.setdefault('CUBLAS_WORKSPACE_CONFIG', ':4096:8')  # without it the order of cuBLAS sums varies
    torch.set_num_threads(config.training.threads)
    torch.use_deterministic_algorithms(True)
    return torch.device('cuda' if found and wanted != 'cpu' else 'cpu')


@dataclass
class Training:
    """The optimisation: attempts, epochs, the best weights so far, and the stopping rule."""

    dataset: Dataset
    held_out: np.ndarray
    config: TrainConfig
    device: torch.device
    run_log: Run
    progress: Progress
    counters: Counters
    attempt: Attempt
    best: dict[str, torch.Tensor]

    @classmethod
    def resumed(
        cls,
        dataset: Dataset,
        held_out: np.ndarray,
        config: TrainConfig,
        device: torch.device,
        run: Run,
        progress: Progress,
    ) -> Training:
        """Continue an earlier start of the same run, or start from the beginning."""
        found = run.resume()
        counters = found.counters if found else Counters()
        attempt = Attempt.begin(dataset, held_out, restarted(config, counters.attempt), device)
        training = cls(dataset, held_out, config, device, run, progress, counters, attempt, {})
        training.best = training._weights()
        if found:
            training._restore(found)
        return training

    def _restore(self, found: Snapshot) -> None:
        self.attempt.network.load_state_dict(found.part('network'))
        self.best = found.part('best')
        checkpoint.restore_optimiser(self.attempt.optimiser, found.part('optimiser'))
        checkpoint.restore_random(found.part('random'))
        more = self.counters.ended == 'most epochs' and self.counters.epoch < self.config.training.epochs
        if more:
            self.counters.ended = ''
        state = f'had ended ({self.counters.ended})' if self.counters.ended else 'continues'
        self.say(f'the run {state} after epoch {self.counters.epoch}; --fresh trains it again')

    def say(self, text: str) -> None:
        """Show a line to the person, and write it into the run's log."""
        self.progress.say(text)
        self.run_log.note(text)

    def run(self) -> None:
        """Epochs until the validation loss has not fallen for the paper's 50 of them."""
        counters, most = self.counters, self.config.training.epochs
        if counters.ended:
            return
        title = 'training' if counters.epoch == 0 else f'training from epoch {counters.epoch + 1}'
        kept_s = counters.seconds
        with self.progress.bar(title, most - counters.epoch) as bar:
            while not (ended := self._ended()):
                text = self._epoch()
                if counters.seconds - kept_s >= self.config.training.checkpoint_s:
                    self.run_log.keep(self._snapshot())
                    kept_s = counters.seconds
                bar.advance(1, text)
        counters.ended = ended
        self.run_log.keep(self._snapshot())
        if not counters.spoke_epoch:
            self.say('the network predicts only zero: check the data (tactile dataset info), or let it run longer')

    def _ended(self) -> str:
        """Why training has ended; empty while it goes on."""
        counters, chosen = self.counters, self.config.training
        if counters.epoch >= chosen.epochs:
            return 'most epochs'
        if counters.spoke_epoch and counters.epoch - max(counters.best_epoch, counters.spoke_epoch) >= chosen.patience:
            return f'{chosen.patience} epochs without a better validation loss'
        return ''

    def _epoch(self) -> str:
        """One more epoch; returns the text under the progress bar."""
        counters, begun = self.counters, clock.perf_ns()
        self._leave_plateau()
        loss = self.attempt.epoch(counters.epoch + 1 - counters.attempt_start)
        measured = self.attempt.validate()
        counters.epoch += 1
        self._remember(measured)
        counters.seconds += (clock.perf_ns() - begun) / clock.NS_PER_S
        rate = self.attempt.optimiser.param_groups[0]['lr']
        scores = {**asdict(measured), 'loss': loss, 'learning_rate': rate, 'seconds': counters.seconds}
        self.run_log.record(counters.epoch, {'attempt': counters.attempt, **scores})
        return f'loss {loss:.4f}  {measured}  best {counters.best_armse_n:.4f} N at epoch {counters.best_epoch}'

    def _leave_plateau(self) -> None:
        """Restart if the network has given no answer for too long."""
        counters, chosen = self.counters, self.config.training
        silent = counters.epoch - counters.attempt_start
        over = counters.spoke_epoch or silent < chosen.plateau_epochs or counters.attempt >= MOST_RESTARTS
        if over or chosen.plateau == 'wait':
            return
        counters.attempt, counters.attempt_start = counters.attempt + 1, counters.epoch
        counters.best_epoch, counters.best_armse_n = counters.epoch, float('inf')
        self.attempt = Attempt.begin(self.dataset, self.held_out, restarted(self.config, counters.attempt), self.device)
        self.say(
            f'epoch {counters.epoch}: {silent} epochs of the all-zero answer that sparse labels reward; starting again '
            '(features over their spread, balanced weights, squared error first)'
        )

    def _remember(self, measured: Validation) -> None:
        """Keep the best weights: the first that give an answer, then those with the lowest validation loss."""
        counters = self.counters
        first_word = not measured.silent and not counters.spoke_epoch
        if first_word:
            counters.spoke_epoch = counters.epoch
        if first_word or measured.armse_n < counters.best_armse_n:
            counters.best_armse_n, counters.best_epoch = measured.armse_n, counters.epoch
            self.best = self._weights()

    def _weights(self) -> dict[str, torch.Tensor]:
        return {name: value.detach().clone() for name, value in self.attempt.network.state_dict().items()}

    def _snapshot(self) -> Snapshot:
        tensors = {
            **{f'network.{name}': value for name, value in self.attempt.network.state_dict().items()},
            **{f'best.{name}': value for name, value in self.best.items()},
            **checkpoint.optimiser_tensors(self.attempt.optimiser),
            **checkpoint.random_tensors(),
        }
        return Snapshot(self.counters, tensors)

    def readout(self) -> NetworkReadout:
        """The best network."""
        attempt = self.attempt
        network = as_mlp(self.best, self.config.network.activation)
        return NetworkReadout(attempt.scaling, network, self.config.bins, attempt.scale_n)

    def report(self) -> dict[str, Any]:
        """The card's entries about the training."""
        counters, used = self.counters, self.attempt.config
        return {
            'settings': {**asdict(used.training), **asdict(used.network)},
            'epochs_run': counters.epoch,
            'best_epoch': counters.best_epoch,
            'ended': counters.ended,
            'restarts': counters.attempt,
            'predicts_nothing': not counters.spoke_epoch,
            'seconds': round(counters.seconds, 1),
            'device': self._device_name(),
        }

    def _device_name(self) -> str:
        import torch

        if self.device.type == 'cuda':
            return f'cuda ({torch.cuda.get_device_name()})'
        return f'cpu, {torch.get_num_threads()} threads'
