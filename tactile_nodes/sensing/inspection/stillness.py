"""Pictures in which nothing moves, told from those in which something does in places."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

NEAREST, TIMES, LEAST_PX = 3, 2.5, 0.02
"""How many others have to be alike; times their distance from which a picture is not; a distance that nobody minds.
Untouched pictures, simulated and of a compressed video, differed by at most 1.8 times, clearly pressed ones by 4."""


def apart_px(motion: Float[np.ndarray, 'pictures regions 2']) -> Float[np.ndarray, 'pictures pictures']:
    """How far pictures differ: motion between them beyond that of all regions, by its fourth power's mean.

    Noise is alike everywhere; a contact is large in few regions, and the fourth power heeds those: of 1 px in one
    region of 81, and nothing else, it makes 0.33 px, where the root mean square is 0.11 px.
    """
    return np.array([_uneven_px(motion - each) for each in motion])


def _uneven_px(motion: Float[np.ndarray, 'pictures regions 2']) -> Float[np.ndarray, ' pictures']:
    motion = motion - np.median(motion, axis=1, keepdims=True)
    return np.asarray(np.mean(np.square(motion).sum(axis=-1) ** 2, axis=-1) ** 0.25)


def alike(apart: Float[np.ndarray, 'pictures pictures']) -> tuple[int, Bool[np.ndarray, ' pictures']]:
    """The picture that has the nearest others, and which ones differ from it by no more than those do (two or more)."""
    nearest = np.sort(apart, axis=1)[:, min(NEAREST, len(apart) - 1)]
    middle = int(np.argmin(nearest))
    return middle, apart[middle] <= max(TIMES * nearest[middle], LEAST_PX)
