from __future__ import annotations

import pytest

from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable, solve
from tactile_nodes.simulation.scene import Scene


@pytest.fixture(scope='session')
def gel() -> Gel:
    return Gel()


@pytest.fixture(scope='session')
def table(gel: Gel) -> ContactTable:
    return solve(gel)


@pytest.fixture(scope='session')
def scene(gel: Gel, table: ContactTable) -> Scene:
    return Scene(gel, table=table)
