"""A training run as a folder: its settings, its epochs, its checkpoint, and its result.

::

    runs/paper-3f1c09a2b7/
        run.yaml                the run with every default filled in
        metrics.jsonl           one line per epoch: losses, scores, seconds
        log.txt                 messages shown
        checkpoint.safetensors  state from which the next start continues
        result.json             the card of the resulting model
        tensorboard/            the same curves as event files, if tensorboard is installed

The digits in the name depend on the run and its data, so the same command finds its folder again.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from tactile_nodes import __version__
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.files import TEXT_BYTES, read_text
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.run import checkpoint
from tactile_nodes.params import load_mapping

if TYPE_CHECKING:
    from tactile_nodes.learning.run.checkpoint import Snapshot

WITHOUT_EFFECT = {'processes', 'checkpoint_s', 'epochs'}
"""Settings that may change when a run is continued. With more epochs it trains further."""

MEASURED = {'epoch', 'seconds', 'loss', 'armse_n', 'rmse_mc_n', 'd_loc_mm'}
"""Values in every line of metrics.jsonl; there may be others."""

METRICS_BYTES = 64 << 20
"""A hundred thousand epochs need less."""


class Run:
    """Stores nothing: for tests, and for use as a library."""

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *args: object) -> None:
        """Release the run."""

    def resume(self) -> Snapshot | None:
        """The state at which an earlier start of this run stopped."""
        return None

    def keep(self, snapshot: Snapshot) -> None:
        """Store the state of the training."""

    def record(self, epoch: int, measured: Mapping[str, float]) -> None:
        """Record one epoch's losses and scores."""

    def note(self, text: str) -> None:
        """Record a message."""

    def finish(self, result: Mapping[str, Any]) -> None:
        """End the run with this card as its result."""


class RunFolder(Run):
    """A run in its own folder. It is locked against other processes until it is released (``with``).

    Raises:
        ConfigurationError: another process trains it at this moment, or the folder cannot be written.
    """

    def __init__(self, parent: Path, config: TrainConfig, fingerprint: str, *, fresh: bool = False) -> None:
        self.path = parent / f'{config.output.stem}-{run_id(config, fingerprint)}'
        try:
            if fresh and self.path.is_dir():
                self._lock(self.path).close()
                shutil.rmtree(self.path)
            self.path.mkdir(parents=True, exist_ok=True)
            self._held = self._lock(self.path)
            (self.path / 'run.yaml').write_text(yaml.safe_dump(config.resolved(), sort_keys=False), encoding='utf-8')
        except OSError as error:
            raise ConfigurationError(
                f'cannot write the run to {self.path} ({error.strerror}); choose another place with --runs'
            ) from error
        self._scalars: Callable[[int, Mapping[str, float]], None] | None = None

    @staticmethod
    def _lock(path: Path) -> Any:
        """The kernel releases the lock when the process ends, in any way."""
        opened = (path / '.lock').open('w')
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            opened.close()
            raise ConfigurationError(
                f'another process is training {path} right now; wait for it, or change the run, for example its seed'
            ) from error
        return opened

    @property
    def _checkpoint(self) -> Path:
        return self.path / 'checkpoint.safetensors'

    def __exit__(self, *args: object) -> None:
        self._held.close()

    def resume(self) -> Snapshot | None:
        found = checkpoint.read(self._checkpoint)
        epoch = found.counters.epoch if found else 0
        file = self.path / 'metrics.jsonl'
        kept = [line for line in _whole_lines(file) if _json(line, file, _is_epoch)['epoch'] <= epoch]
        file.write_text(''.join(kept), encoding='utf-8')
        self._scalars = _event_writer(self.path / 'tensorboard', epoch)
        return found

    def keep(self, snapshot: Snapshot) -> None:
        checkpoint.write(self._checkpoint, snapshot)

    def record(self, epoch: int, measured: Mapping[str, float]) -> None:
        with (self.path / 'metrics.jsonl').open('a', encoding='utf-8') as file:
            file.write(json.dumps({'epoch': epoch, **measured}) + '\n')
        if self._scalars:
            self._scalars(epoch, measured)

    def note(self, text: str) -> None:
        with (self.path / 'log.txt').open('a', encoding='utf-8') as file:
            file.write(f'{text}\n')

    def finish(self, result: Mapping[str, Any]) -> None:
        (self.path / 'result.json').write_text(json.dumps(result, indent=1, sort_keys=True), encoding='utf-8')


def run_id(config: TrainConfig, fingerprint: str) -> str:
    """Ten hexadecimal digits of a hash over everything that the network depends on."""
    settings = {name: value for name, value in config.resolved().items() if name not in ('output', 'data')}
    settings['training'] = {name: value for name, value in settings['training'].items() if name not in WITHOUT_EFFECT}
    split = {name: getattr(config.data, name) for name in ('split', 'split_seed', 'test')}
    everything = {'release': __version__, 'data': fingerprint, 'run': settings, **split}
    return hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()[:10]


def _whole_lines(file: Path) -> list[str]:
    """The complete lines of a file. A line truncated by a kill is dropped."""
    return [line for line in _text(file, METRICS_BYTES).splitlines(keepends=True) if line.endswith('\n')]


def _text(file: Path, largest: int = TEXT_BYTES) -> str:
    """The content of a run's file; empty if there is none yet."""
    try:
        return read_text(file, largest)
    except FileNotFoundError:
        return ''
    except OSError as error:
        raise _damaged(file, str(error.strerror)) from error
    except UnicodeDecodeError as error:
        raise _damaged(file, 'it is not text') from error


def _json(text: str, file: Path, fits: Callable[[Mapping[str, Any]], bool]) -> Mapping[str, Any]:
    """The parsed JSON of a file's text, checked for the form of this file."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _damaged(file, 'it is not JSON') from error
    if not isinstance(content, dict) or not fits(content):
        raise _damaged(file, 'numbers are missing')
    return content


def _is_epoch(entries: Mapping[str, Any]) -> bool:
    return entries.keys() >= MEASURED and all(map(_is_number, entries.values()))


def _is_card(card: Mapping[str, Any]) -> bool:
    training, scores = card.get('training'), card.get('validation', {})
    if not isinstance(training, dict) or not isinstance(scores, dict):
        return False
    return all(map(_is_number, [training.get('seconds'), *scores.values()]))


def _is_number(value: object) -> bool:
    """Whether it is a number that can be printed and drawn, including NaN and infinity."""
    return isinstance(value, float) or (isinstance(value, int) and abs(value) < 1 << 53)


def _damaged(file: Path, why: str) -> ConfigurationError:
    return ConfigurationError(f'{file} is damaged ({why}); name another run, or train this one again with --fresh')


def _event_writer(folder: Path, epoch: int) -> Callable[[int, Mapping[str, float]], None] | None:
    """A function that writes TensorBoard's event files, if installed. Curves after `epoch` are replaced."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    writer = SummaryWriter(str(folder), purge_step=epoch + 1)

    def write(at: int, measured: Mapping[str, float]) -> None:
        for name, value in measured.items():
            writer.add_scalar(name, value, at)
        writer.flush()

    return write


@dataclass(frozen=True)
class StoredRun:
    """A run as read from its folder; `settings` by dotted name."""

    name: str
    settings: Mapping[str, object]
    epochs: list[Mapping[str, float]]
    result: Mapping[str, Any]


def read_run(path: Path) -> StoredRun:
    """A run, finished or not.

    Raises:
        ConfigurationError: the folder holds no run, or a damaged one.
    """
    try:
        settings = load_mapping(path / 'run.yaml')
    except ConfigurationError as error:
        raise ConfigurationError(
            f'{path} does not hold a training run ({error}); give a folder that tactile train made'
        ) from error
    metrics, result = path / 'metrics.jsonl', path / 'result.json'
    epochs = [_json(line, metrics, _is_epoch) for line in _whole_lines(metrics)]
    card = _text(result)
    return StoredRun(
        path.name,
        {name: located.value for name, located in settings.items()},
        epochs,
        _json(card, result, _is_card) if card else {},
    )
