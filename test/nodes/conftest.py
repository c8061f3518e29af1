"""A bus inside the process, a stepped clock, and ways to feed nodes by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from feeding import START_NS

from tactile_nodes import model_file
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Publisher, Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceModel
from tactile_nodes.sensing.explain.network import InputScaling, Mlp, NetworkReadout
from tactile_nodes.sensing.geometry import BinGrid


@pytest.fixture
def clock() -> SteppedClock:
    return SteppedClock(START_NS)


@pytest.fixture
def bus(clock: SteppedClock) -> Iterator[InProcessBus]:
    made = InProcessBus(clock)
    yield made
    made.close()


@pytest.fixture
def listen(bus: InProcessBus) -> Callable[[Topic], Subscription]:
    return lambda topic: bus.subscribe('/' + topic.name.lstrip('/'), topic.type_name, Qos('queue', 100))


@pytest.fixture
def publisher(bus: InProcessBus) -> Callable[[Topic], Publisher]:
    return lambda topic: bus.advertise('/' + topic.name.lstrip('/'), topic.type_name, topic.qos)


@pytest.fixture
def small_model(tmp_path: Path) -> Path:
    """A model file for 160x160 images with 4x4 regions of mean motion, whose answer is its last bias."""
    layout = FeatureLayout('cartesian_mean', 4, 4, 2)
    bins = BinGrid(3, 3, 30.0, 30.0)
    bias = np.zeros(9, np.float32)
    bias[5] = 0.5  # row 1, column 2: centre (10, 0) mm
    network = Mlp(
        (np.zeros((6, 32), np.float32), np.zeros((9, 6), np.float32)),
        (np.zeros(6, np.float32), bias),
    )
    scaling = InputScaling(
        np.zeros((4, 4, 2), np.float32), np.ones((4, 4, 2), np.float32), np.ones((4, 4), np.float32), 0.5
    )
    file = tmp_path / 'small.safetensors'
    card = {
        'flow': {'name': 'dis', 'options': {}},
        'encoding': {'name': 'cartesian_mean', 'options': {}},
        'crop_px': 160,
        'gel': {'id': 'gel of the test'},
    }
    model_file.save_model(file, ForceModel(layout, bins, NetworkReadout(scaling, network, bins)), card)
    return file


@pytest.fixture
def patches_model(small_model: Path, tmp_path: Path) -> Path:
    """The same for a flow of one patch a region."""
    loaded, regions = model_file.load_model(small_model), {'rows': 4, 'cols': 4}
    card = {
        'flow': {'name': 'inverse_compositional', 'options': {**regions, 'finest_scale': 1}},
        'encoding': {'name': 'cartesian_mean', 'options': regions},
        'crop_px': loaded.card['crop_px'],
        'gel': loaded.card['gel'],
    }
    model_file.save_model(tmp_path / 'patches.safetensors', loaded.model, card)
    return tmp_path / 'patches.safetensors'
