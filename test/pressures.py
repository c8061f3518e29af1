"""Hertz's pressure over a disc, written out at points, as theory has it."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.elasticity.layer import ElasticLayer


def hertz(layer: ElasticLayer, radius_mm: float) -> np.ndarray:
    """Its spectrum: the pressure is as sqrt(1 - r² / a²)."""
    line = np.linspace(-1, 1, 60)[1::2]
    place = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    height = np.sqrt(np.maximum(1 - np.square(place).sum(axis=1), 0.0))
    return layer.points(radius_mm * place[height > 0], height[height > 0])
