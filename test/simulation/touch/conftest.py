from __future__ import annotations

import numpy as np
import pytest


@pytest.fixture
def ball_5_mm() -> tuple[np.ndarray, np.ndarray]:
    """Force over the shear modulus and depth of a sticking sphere of 5 mm on 6 mm of rubber (`Problem` of
    tactile_nodes/simulation/solution.py with Indenter(5, 5), finest_mm=0.15: a minute, so its numbers stand here)."""
    return np.array([9.0, 27.0]), np.array([0.6419, 1.1900])
