"""Models `field` of one gel, calibrated with different numbers of presses on the same gel, or without any."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.learning.config import Choice, DataConfig, TrainConfig
from tactile_nodes.learning.datasets.simulated import Dataset, simulate
from tactile_nodes.learning.field.calibration import with_field
from tactile_nodes.learning.field.fit import described
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.checks import source_readout
from tactile_nodes.learning.transfer.fit import transfer
from tactile_nodes.model_file import LoadedModel, save_model
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensors import load_sensor
from tactile_nodes.simulation.gel import Gel

DEEPEST_MM, SHALLOWEST_MM = 1.15, 0.25
"""Range in which the layer responds linearly; deeper presses do not improve the estimates of other contacts."""

UNTOUCHED = 0.5
"""One picture of the untouched gel for every two presses, as in a calibration."""


def calibrated(source: LoadedModel, gel: Gel, presses: int, folder: Path, progress: Progress) -> Path:
    """The file of a model of a gel, from `presses` of the paper's tip, or from the description alone if 0."""
    file = folder / f'field-{presses}.safetensors'
    readout = source.model.readout
    assert isinstance(readout, FieldReadout)
    card: dict[str, Any] = dict(source.card)
    if presses:
        dataset = _pressed(source, gel, presses, progress)
        tips = transfer(source_readout(source), dataset, progress, forced=True)
        made = with_field(source, tips, dataset, progress, forced=True)
        fitted = made.readout
    else:
        scaling = replace(readout.scaling, mean=np.zeros_like(readout.scaling.mean))
        fitted = described(load_sensor('simulated'), scaling, progress).readout
    card['gel'] = {'id': gel.gel_id}
    save_model(file, replace(source.model, readout=fitted, model_id='unsaved'), card)
    return file


def _pressed(source: LoadedModel, gel: Gel, presses: int, progress: Progress) -> Dataset:
    """Presses spread as widely as possible, at random depths, with pictures of the untouched gel."""
    data = DataConfig(
        plan='spread', presses=presses, seed=gel.seed, reach_mm=13.5, shallowest_mm=SHALLOWEST_MM,
        deepest_mm=DEEPEST_MM, without_contact=UNTOUCHED, presses_per_rest_image=0,
    )  # fmt: skip
    flow, encoding = Choice(*source.flow), Choice(*source.encoding)
    return simulate(TrainConfig(data=data, flow=flow, encoding=encoding, gel=gel), progress)
