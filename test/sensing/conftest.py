from __future__ import annotations

import cv2
import numpy as np
import pytest


@pytest.fixture(scope='session')
def speckle() -> np.ndarray:
    """A random pattern of the paper's crop size, smooth enough to be shifted by parts of a pixel."""
    random = np.random.default_rng(0).uniform(0, 255, (440, 440)).astype(np.float32)
    smooth = cv2.GaussianBlur(random, (0, 0), 2.0)
    spread = (smooth - smooth.mean()) / smooth.std()
    return np.clip(128 + 40 * spread, 0, 255).astype(np.uint8)
