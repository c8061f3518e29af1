"""The simulated sensor with 20x20 regions, and their response without any press."""

import numpy as np
import pytest

from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.explain.field.solver import FieldSolver
from tactile_nodes.sensing.explain.field.weights import camera_ways
from tactile_nodes.sensors import Sensor

SIDE, NOISE_PX = 20, 0.004


@pytest.fixture(scope='session')
def regions() -> Regions:
    return Regions(Sensor(), SIDE, SIDE)


@pytest.fixture(scope='session')
def response(regions: Regions) -> np.ndarray:
    terms = regions.terms_of_patches(np.arange(regions.count), slopes=False)
    motion = np.einsum('rptu,t->rpu', terms, regions.nominal_shares[::3].astype(np.float32))
    return np.ascontiguousarray(motion.reshape(2 * regions.count, -1))


@pytest.fixture(scope='session')
def solver(regions: Regions, response: np.ndarray) -> FieldSolver:
    camera = camera_ways((SIDE, SIDE), np.arange(regions.count))
    return FieldSolver(response, camera, regions.patches, NOISE_PX, 0.02)
