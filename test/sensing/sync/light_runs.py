"""The edges of a light in all frames of a run at once, to compare with what is found frame by frame."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.sync.light import LightEdges, _edges, _levels, _share


def light_edges(start_ns: np.ndarray, brightness: np.ndarray, exposure_s: float, contrast: float = 20.0) -> LightEdges:
    """Edges from the brightness in each frame and the start of its exposure; arguments as of `LightWatch`."""
    return _edges(start_ns, _share(brightness, _levels(brightness, contrast)), exposure_s)
