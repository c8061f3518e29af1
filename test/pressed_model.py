"""A small response model of the simulated gel, measured with few presses: quick to make and quick to transfer."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from press_bags import Sensor

from tactile_nodes.learning.config import ResponseConfig
from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.response_fit import fit_response
from tactile_nodes.model_file import save_model
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow import make_flow
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.model import FeatureLayout, ForceModel
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Press

SIDE = 8
REGIONS = {'rows': SIDE, 'cols': SIDE}
FLOW, FLOW_OPTIONS = 'inverse_compositional', {**REGIONS, 'finest_scale': 1}
ENCODING = 'cartesian_mean'
CONFIG = ResponseConfig(components=12, spacing_mm=3.0, levels=3, smoothing=(1e-2,), most_contacts=1)
OTHER = dataclasses.replace(Gel(), seed=2, shear_modulus_mpa=1.5 * Gel().shear_modulus_mpa, camera_shift_mm=(0.6, -0.4))
PRESSES, STILL, REACH_MM = 200, 40, 12.0


def measured(sensor: Sensor, presses: int, still: int, seed: int) -> Dataset:
    """Presses anywhere on a gel, 0.2 to 1.7 mm deep, and frames without contact."""
    random = np.random.default_rng(seed)
    flow, encoding = make_flow(FLOW, FLOW_OPTIONS), make_encoding(ENCODING, REGIONS)
    rest = sensor.rest()
    flow.set_reference(rest)
    encoding.set_reference(rest)
    features, rows = [], []
    for number in range(presses + still):
        x, y = random.uniform(-REACH_MM, REACH_MM, 2)
        depth = float(random.uniform(0.2, 1.7)) if number < presses else -1.0
        image = sensor.image(*([Press(float(x), float(y), depth)] if depth > 0 else []))
        features.append(encoding.encode(flow.displacement(image)).values.astype(np.float16))
        rows.append((x, y, depth, sensor.table.force_at(depth) if depth > 0 else 0.0))
    confidence = np.ones((1, SIDE, SIDE), np.float32)
    count = presses + still
    return Dataset(np.stack(features), np.array(rows, np.float32), np.zeros(count, int), confidence, 'pressed')


def small_response(file: Path, sensor: Sensor, gel: str = 'first') -> Path:
    """A model file of the sensor's gel."""
    dataset, bins = measured(sensor, PRESSES, STILL, seed=11), BinGrid()
    readout = fit_response(dataset, np.zeros(PRESSES + STILL, bool), CONFIG, bins, Progress())
    options = make_flow(FLOW, FLOW_OPTIONS).options
    encoding = make_encoding(ENCODING, REGIONS)
    card = {
        'flow': {'name': FLOW, 'options': options},
        'encoding': {'name': ENCODING, 'options': encoding.options},
        'crop_px': 440, 'gel': {'id': gel}, 'data': {'origin': 'simulated'},
    }  # fmt: skip
    save_model(file, ForceModel(FeatureLayout(ENCODING, SIDE, SIDE, 2), bins, readout), card)
    return file
