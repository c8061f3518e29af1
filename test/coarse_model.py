"""Small models: those that ship for calibrations, on a quarter of their regions, and a network of random weights.

With the first ones a calibration takes a third of the time; what the network says is nonsense, but it says it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.learning.config import Choice, DataConfig, TrainConfig
from tactile_nodes.learning.field.fit import described
from tactile_nodes.model_file import find_model, load_model, save_model
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceModel
from tactile_nodes.sensing.explain.network import InputScaling, Mlp, NetworkReadout, TotalSpread
from tactile_nodes.sensors import load_sensor

SHAPE = (10, 10, 2)


def coarse_model(file: Path, gel: str) -> Path:
    """Each of its regions is four of theirs: it lies in their middle and moves by their mean."""
    loaded = load_model(find_model('portable'))
    readout, layout = loaded.model.readout, loaded.model.layout
    assert isinstance(readout, AxisymmetricReadout)
    trusted, rows, cols = readout.scaling.trusted > 0, layout.rows // 2, layout.cols // 2
    whole = trusted.reshape(rows, 2, cols, 2).all(axis=(1, 3))

    def coarse(fine: np.ndarray) -> np.ndarray:
        return np.asarray(fine.reshape(rows, 2, cols, 2, *fine.shape[2:]).mean(axis=(1, 3)), fine.dtype)

    def of_known(fine: np.ndarray) -> np.ndarray:
        spread = np.zeros((*trusted.shape, *fine.shape[1:]))
        spread[trusted] = fine
        return coarse(spread)[whole]

    scaling, response = readout.scaling, readout.response
    made = replace(
        readout, scaling=InputScaling(
            coarse(scaling.mean), coarse(scaling.gain), whole.astype(np.float32), scaling.confidence_floor
        ),
        response=replace(response, places=of_known(response.places), couplings=of_known(response.couplings)),
    )  # fmt: skip
    card: dict[str, Any] = {**loaded.card, 'gel': {'id': gel}}
    for name in ('flow', 'encoding'):
        card[name] = {**card[name], 'options': {**card[name]['options'], 'rows': rows, 'cols': cols}}
    save_model(file, ForceModel(replace(layout, rows=rows, cols=cols), loaded.model.bins, made), card)
    return file


def coarse_field(file: Path) -> Path:
    """The model of any contact as its description has it, with the same readout of tips."""
    tips, field = load_model(coarse_model(file, 'first')), load_model(find_model('field'))
    assert isinstance(tips.model.readout, AxisymmetricReadout)
    scaling = replace(tips.model.readout.scaling, mean=np.zeros_like(tips.model.readout.scaling.mean))
    readout = replace(described(load_sensor('simulated'), scaling).readout, tips=tips.model.readout)
    save_model(file, replace(tips.model, readout=readout), {**field.card, **{
        name: tips.card[name] for name in ('flow', 'encoding')
    }})  # fmt: skip
    return file


def config_of(**data: object) -> TrainConfig:
    """That of a training on presses of seed 3."""
    encoding = Choice('cartesian_mean', {'rows': SHAPE[0], 'cols': SHAPE[1]})
    return TrainConfig(data=DataConfig(**{'seed': 3, **data}), encoding=encoding)  # type: ignore[arg-type]


def random_network(
    file: Path,
    config: TrainConfig,
    *,
    hidden: tuple[int, ...] = (),
    size: float = 0.01,
    seed: int = 1,
    spread: TotalSpread | None = None,
    origin: Mapping[str, object] | None = None,
    seconds: float = 2.0,
) -> Path:
    """Save it as trained in so many seconds with simulated presses, or with those of another origin."""
    random, ones = np.random.default_rng(seed), np.ones(SHAPE, np.float32)
    widths = (int(np.prod(SHAPE)), *hidden, config.bins.count)
    weights = tuple(random.normal(0, size, (n, m)).astype(np.float32) for m, n in pairwise(widths))
    network = Mlp(weights, tuple(np.zeros(n, np.float32) for n in widths[1:]))
    scaling = InputScaling(0 * ones, ones, ones[..., 0])
    readout = NetworkReadout(scaling, network, config.bins, spread=spread or TotalSpread())
    card = {
        'flow': {'name': config.flow.name, 'options': config.make_flow().options},
        'encoding': {'name': config.encoding.name, 'options': config.make_encoding().options},
        'crop_px': 440, 'gel': {'id': config.gel.gel_id, **asdict(config.gel)},
        'data': origin or {**config.data.simulated(), 'origin': 'simulated'},
        'training': {'seconds': seconds, 'device': 'cpu'},
    }  # fmt: skip
    save_model(file, ForceModel(FeatureLayout(config.encoding.name, *SHAPE), config.bins, readout), card)
    return file
