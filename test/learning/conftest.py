from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from press_bags import Sensor, whole_collection


@pytest.fixture(scope='session')
def sensor() -> Sensor:
    return Sensor()


@pytest.fixture(scope='session')
def bag(tmp_path_factory: pytest.TempPathFactory, sensor: Sensor) -> Path:
    return whole_collection(tmp_path_factory.mktemp('bags') / 'collected', sensor)


@pytest.fixture(scope='module')
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Nothing is known of earlier measurements."""
    folder = tmp_path_factory.mktemp('cache')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_CACHE_HOME', str(folder))
        yield folder
