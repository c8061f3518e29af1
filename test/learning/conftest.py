from __future__ import annotations

from pathlib import Path

import pytest
from press_bags import Sensor, whole_collection


@pytest.fixture(scope='session')
def sensor() -> Sensor:
    return Sensor()


@pytest.fixture(scope='session')
def bag(tmp_path_factory: pytest.TempPathFactory, sensor: Sensor) -> Path:
    return whole_collection(tmp_path_factory.mktemp('bags') / 'collected', sensor)
