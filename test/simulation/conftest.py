from __future__ import annotations

import pytest
from coarse_table import linear_table

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.scene import Scene


@pytest.fixture(scope='session')
def gel() -> Gel:
    return Gel()


@pytest.fixture(scope='session')
def table() -> ContactTable:
    """The linear layer of the paper's size."""
    return linear_table(Gel(mechanics='linear', shear_modulus_mpa=0.155))


@pytest.fixture(scope='session')
def scene(gel: Gel, table: ContactTable) -> Scene:
    return Scene(gel, table=table)


@pytest.fixture(scope='session')
def finite_table() -> ContactTable:
    """The paper's gel at finite strain, from the table that ships."""
    return contact_table(Gel(mechanics='finite_strain', shear_modulus_mpa=0.111))
