from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from press_bags import Sensor, whole_collection
from responding_gel import AXISYMMETRIC, presses

from tactile_nodes.learning.axisymmetric.fit import fit_axisymmetric
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.simulation.optics import Shaping


class KeptImages(Sensor):
    """Renders an image that is the same as an earlier one no second time."""

    def __init__(self) -> None:
        super().__init__()
        self._kept: dict[tuple[object, ...], np.ndarray] = {}

    def image(self, *presses: Shaping) -> np.ndarray:
        key = self._seed, *presses
        if key in self._kept:
            self._seed += 1
        else:
            self._kept[key] = super().image(*presses)
            self._kept[key].flags.writeable = False
        return self._kept[key]


@pytest.fixture(scope='session')
def sensor() -> Sensor:
    return KeptImages()


@pytest.fixture(scope='session')
def bag(tmp_path_factory: pytest.TempPathFactory, sensor: Sensor) -> Path:
    sensor.begin_anew()
    return whole_collection(tmp_path_factory.mktemp('bags') / 'collected', sensor)


@pytest.fixture(scope='session')
def known_gel() -> AxisymmetricReadout:
    """The response of the gel of `responding_gel`, fitted to three quarters of 500 presses."""
    return fit_axisymmetric(presses(500, seed=1), np.arange(500) % 4 == 1, AXISYMMETRIC, BinGrid(), Progress())
