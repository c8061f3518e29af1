"""Compares training runs: the settings in which they differ, their results, and their curves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tactile_nodes.learning.figures import figure, save
from tactile_nodes.learning.run.folder import StoredRun

SCORES = ('armse_n', 'rmse_mc_n', 'd_loc_mm', 'total_rmse_n', 'right_bin')
CURVES = {
    'armse_n': 'aRMSE, held out [N]',
    'rmse_mc_n': 'RMSE_mc, held out [N]',
    'd_loc_mm': 'd_loc, held out [mm]',
    'loss': 'loss, training [unit of the outputs]',
}


def table(runs: Sequence[StoredRun]) -> str:
    """Settings that differ, then the scores of the best epoch, one column per run."""
    settings = [run.settings for run in runs]
    names = dict.fromkeys(name for each in settings for name in each)
    differing = [name for name in names if len({str(each.get(name)) for each in settings}) > 1]
    rows = [['', *(run.name for run in runs)]]
    rows += [[name, *(str(each.get(name, '-')) for each in settings)] for name in differing]
    outcomes = [_outcome(run) for run in runs]
    rows += [[name, *(each[name] for each in outcomes)] for name in outcomes[0]]
    widths = [max(len(row[column]) for row in rows) for column in range(len(runs) + 1)]
    return '\n'.join(
        '  '.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def _outcome(run: StoredRun) -> dict[str, str]:
    """The result of a run, or its result so far."""
    training = run.result.get('training', {})
    best = run.result.get('validation') or min(run.epochs, key=lambda each: each['armse_n'], default={})
    seconds = training.get('seconds', run.epochs[-1]['seconds'] if run.epochs else None)
    return {
        'model': str(run.result.get('model_id', '(not finished)')),
        'parameters': str(run.result.get('parameters', '-')),
        'epochs': str(training.get('epochs_run', len(run.epochs) or '-')),
        'ended': str(training.get('ended', '-')),
        'seconds': '-' if seconds is None else f'{seconds:.0f}',
        'device': str(training.get('device', '-')),
        **{f'held out: {name}': f'{best[name]:.4f}' if name in best else '-' for name in SCORES},
    }


def draw(runs: Sequence[StoredRun], file: Path) -> None:
    """Write the curves over training time [s], with points for runs without epochs. The extension selects the format.

    Raises:
        ConfigurationError: matplotlib is not installed, or does not know the extension.
        DatasetError: the file cannot be written.
    """
    drawn = figure(11, 8)
    for axis, (name, label) in zip(drawn.subplots(2, 2).flat, CURVES.items(), strict=True):
        for run in runs:
            seconds, values = _curve(run, name)
            axis.plot(seconds, values, linewidth=1, marker='o' if len(values) == 1 else None, label=run.name)
        if name == 'd_loc_mm':
            axis.set_yscale('symlog', linthresh=0.01)  # it may be zero
        else:
            axis.set_yscale('log')
        axis.set(xlabel='seconds of training', ylabel=label)
        axis.grid(which='both', linewidth=0.3)
    drawn.axes[0].legend(fontsize='small')
    save(drawn, file)


def _curve(run: StoredRun, name: str) -> tuple[list[float], list[float]]:
    """Seconds and values of a run's epochs; a single point with its result for a finished run without epochs."""
    if run.epochs:
        return [each['seconds'] for each in run.epochs], [each[name] for each in run.epochs]
    outcome = run.result.get('validation', {})
    return ([run.result['training']['seconds']], [outcome[name]]) if name in outcome else ([], [])
