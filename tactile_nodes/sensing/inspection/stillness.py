"""Separates pictures without motion from those with local motion."""

from __future__ import annotations

import numpy as np

from tactile_nodes.shapes import Bool, Float

NEAREST, TIMES, LEAST_PX = 3, 2.5, 0.02
"""Number of other pictures that must be alike; multiple of their distance above which a picture differs; a distance
always accepted. Untouched pictures (simulated, compressed video) differed by at most 1.8 times, clearly pressed ones
by 4."""


def apart_px(motion: Float[np.ndarray, 'pictures regions 2']) -> Float[np.ndarray, 'pictures pictures']:
    """Distance of pictures: fourth root of the mean fourth power of the motion relative to the median motion.

    Noise is equal everywhere, while a contact is large in few regions, which the fourth power emphasises: 1 px in one
    of 81 regions gives 0.33 px, where the root mean square is 0.11 px.
    """
    return np.array([_uneven_px(motion - each) for each in motion])


def _uneven_px(motion: Float[np.ndarray, 'pictures regions 2']) -> Float[np.ndarray, ' pictures']:
    motion = motion - np.median(motion, axis=1, keepdims=True)
    return np.asarray(np.mean(np.square(motion).sum(axis=-1) ** 2, axis=-1) ** 0.25)


def alike(apart: Float[np.ndarray, 'pictures pictures']) -> tuple[int, Bool[np.ndarray, ' pictures']]:
    """The picture with the nearest neighbours, and which pictures (two or more) differ no more from it than those."""
    nearest = np.sort(apart, axis=1)[:, min(NEAREST, len(apart) - 1)]
    middle = int(np.argmin(nearest))
    return middle, apart[middle] <= max(TIMES * nearest[middle], LEAST_PX)
