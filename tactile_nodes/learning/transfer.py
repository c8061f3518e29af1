"""Calibrate a model file for another gel: recorded presses on it, the fit, the card, the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from tactile_nodes import __version__, clock
from tactile_nodes.learning.dataset_file import load_dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recordings import RecordedPresses
from tactile_nodes.learning.source import require_same_features
from tactile_nodes.learning.transfer_checks import source_readout
from tactile_nodes.learning.transfer_fit import Transfer, transfer
from tactile_nodes.model_file import LoadedModel, load_model, save_model


def calibrate(
    model_file: Path, dataset_file: Path, output: Path, *, progress: Progress | None = None, command: str = ''
) -> tuple[str, Transfer]:
    """Write the model of the gel that was pressed; its id, and how it came about.

    Raises:
        ModelError: the model cannot be transferred, or reads other features than the data set holds.
        DatasetError: the presses cannot be used, or the calibration would not pay.
    """
    begun = clock.perf_ns()
    loaded, recordings = load_model(model_file), load_dataset(dataset_file)
    readout = source_readout(loaded)
    require_same_features(loaded, recordings)
    made = transfer(readout, recordings.as_samples(), progress)
    seconds = round((clock.perf_ns() - begun) / clock.NS_PER_S, 1)
    card = card_of(loaded, recordings, made, seconds, command)
    model = replace(loaded.model, readout=made.readout, model_id='unsaved')
    return save_model(output, model, card, recordings.rest_image), made


def card_of(
    loaded: LoadedModel, recordings: RecordedPresses, made: Transfer, seconds: float, command: str
) -> dict[str, Any]:
    """What a stranger needs to know about the model: that of its source, and what was pressed."""
    kept = {name: loaded.card[name] for name in ('flow', 'encoding', 'crop_px')}
    return {
        **kept,
        'command': command,
        'made_with': f'tactile_nodes {__version__}',
        'licence': 'the same as tactile_nodes',
        'gel': dict(recordings.card['gel']),
        'data': {
            'origin': 'calibration',
            'bags': [bag['id'] for bag in recordings.card['bags']],
            'samples': len(recordings),
            'fingerprint': recordings.fingerprint,
        },
        'source': {'model_id': loaded.model_id, 'gel': loaded.gel},
        'training': {'seconds': seconds, 'device': 'cpu', 'calibration': made.as_dict()},
    }
