"""Reports and stores the result of tuning: a model and the run that trains it again. Together they are a profile."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path

import yaml

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.datasets.file import save_dataset
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.evaluation.text_table import Table
from tactile_nodes.learning.tuning.search import METRICS, Tried, Tuned
from tactile_nodes.model_file import save_model


def files_of(output: Path, *, recorded: bool) -> list[Path]:
    """The files of a profile: the model, its training run and, if the presses are recorded, their data set.

    Raises:
        ConfigurationError: the name is not that of a model file.
    """
    if output.suffix != '.safetensors':
        raise ConfigurationError(f'the name of a model file must end in .safetensors, got {output}')
    return [output, output.with_suffix('.yaml'), *([output.with_suffix('.npz')] if recorded else [])]


def write_profile(chosen: Tried, output: Path, command: str, presses: RecordedPresses | None = None) -> list[Path]:
    """Write the model and a training run that reproduces it; for recorded presses, also their data set.

    Raises:
        ConfigurationError: a file cannot be written, or as `files_of`.
        DatasetError: the data set cannot be written.
    """
    files = files_of(output, recorded=presses is not None)
    config = replace(chosen.config, output=output)
    if presses is not None:
        save_dataset(files[-1], presses)
        config = replace(config, data=replace(config.data, file=str(files[-1])))
    run = yaml.safe_dump(config.resolved(), sort_keys=False)
    try:
        save_model(output, chosen.model, chosen.card, chosen.rest_image)
        files[1].write_text(f'# Chosen by: {command}\n#   tactile train {files[1]}\n{run}', encoding='utf-8')
    except OSError as error:
        raise ConfigurationError(
            f'cannot write {error.filename} ({error.strerror}); choose another place with -o'
        ) from error
    return files


def table_of(tuned: Tuned) -> Table:
    """A row for each candidate, cheapest first. The front and the chosen candidate, if there is one, are marked."""
    on_front, rows, chosen = {id(each) for each in tuned.front}, [], None
    with suppress(ConfigurationError):
        chosen = tuned.chosen
    for each in sorted(tuned.tried, key=lambda one: one.ms):
        mark = 'chosen' if each is chosen else 'front' if id(each) in on_front else ''
        scores = asdict(each.scores)
        rows.append((each.candidate.name, f'{each.ms:.2f}', *(f'{scores[name]:.4f}' for name in METRICS), mark))
    return Table('', ('flow, regions, components', 'CPU ms', *METRICS, ''), tuple(rows))


def said_of(tuned: Tuned, metric: str) -> str:
    """The choice in a sentence, with the scores of the next smaller one."""
    chosen, smaller = tuned.chosen, tuned.smaller
    first = f'{chosen.candidate.name}: {metric} {chosen.error(metric):.4f} at {chosen.ms:.2f} ms of CPU a frame.'
    if smaller is None:
        return f'{first} There is no smaller one on the front.'
    times = smaller.error(metric) / max(chosen.error(metric), 1e-12)
    return (
        f'{first} The next smaller one, {smaller.candidate.name}, would take {smaller.ms:.2f} ms and cost {times:.2f} '
        f'times the error ({smaller.error(metric):.4f}).'
    )
