"""Models `field` of one gel, calibrated with different numbers of presses on the same gel, or without any."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.learning.config import Choice, DataConfig, TrainConfig
from tactile_nodes.learning.datasets.simulated import Dataset, simulate
from tactile_nodes.learning.field.calibration import Pressed, refinement_of, with_field
from tactile_nodes.learning.field.fit import described
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.checks import source_readout
from tactile_nodes.learning.transfer.fit import transfer
from tactile_nodes.model_file import LoadedModel, save_model
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensors import Sensor, load_sensor
from tactile_nodes.simulation.gel import Gel

DEEPEST_MM, SHALLOWEST_MM = 1.15, 0.25
"""Range in which the layer responds linearly; deeper presses do not improve the estimates of other contacts."""

UNTOUCHED = 0.5
"""One picture of the untouched gel for every two presses, as in a calibration."""


def calibrated(
    source: LoadedModel, gel: Gel, presses: int, folder: Path, progress: Progress, sensor: Sensor | None = None
) -> Path:
    """The file of a model of a gel, from `presses` of the paper's tip, or from the description alone if 0.

    `sensor` is the description, by default the one that ships.
    """
    sensor = sensor or load_sensor('simulated')
    file = folder / f'field-{presses}-{sensor.gel.sides}.safetensors'
    pressed, readout = Pressed(sensor), source.model.readout
    assert isinstance(readout, FieldReadout)
    card: dict[str, Any] = dict(source.card)
    if presses:
        dataset = pressed_by_tip(source, gel, presses, progress)
        tips = transfer(source_readout(source), dataset, progress, forced=True)
        made = with_field(source, tips, dataset, progress, pressed, forced=True)
        fitted = made.readout
    else:
        scaling = replace(readout.scaling, mean=np.zeros_like(readout.scaling.mean))
        fitted = described(sensor, scaling, progress, refinement_of(source, sensor)).readout
    card['gel'] = {'id': gel.gel_id}
    save_model(file, replace(source.model, readout=fitted, model_id='unsaved'), card)
    return file


def pressed_by_tip(
    source: LoadedModel, gel: Gel, presses: int, progress: Progress, plan: str = 'spread', seed: int = 0
) -> Dataset:
    """Presses at random depths, with pictures of the untouched gel; 'spread' as widely as possible, or 'random'.

    `seed` is that of places and depths; 0: that of the gel.
    """
    data = DataConfig(
        plan=plan, presses=presses, seed=seed or gel.seed, reach_mm=13.5, shallowest_mm=SHALLOWEST_MM,
        deepest_mm=DEEPEST_MM, without_contact=UNTOUCHED, presses_per_rest_image=0,
    )  # fmt: skip
    flow, encoding = Choice(*source.flow), Choice(*source.encoding)
    return simulate(TrainConfig(data=data, flow=flow, encoding=encoding, gel=gel), progress)
