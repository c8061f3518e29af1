"""Images of a press that is held still: which belong together, and which show it at rest."""

from __future__ import annotations

import numpy as np

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.shapes import Bool, Float, Float32, Int

LEAST_TO_TELL = 3
"""Of two images that differ, either may be the one that shows the press at rest."""
MOVING = 2.0
"""Limit of the distance from the hold's median, as a multiple of the distance that noise alone causes."""
MOST_MOVED = 0.1
"""Share of the regions, those that a press moves most, that are used to check whether the tip is at rest."""
LEAST_REGIONS = 20
"""Least number of these regions: the median of their distances is then known to a seventh."""


def holds_of(dataset: Dataset, rows: Int[np.ndarray, ' rows']) -> list[Int[np.ndarray, ' pictures']]:
    """The samples that show one press each, in the order of the presses' first images."""
    if dataset.hold is None:
        return list(rows[:, None])
    _, first, number = np.unique(dataset.hold[rows], return_index=True, return_inverse=True)
    order = np.argsort(number, kind='stable')
    together = np.split(rows[order], np.flatnonzero(np.diff(number[order])) + 1)
    return [together[each] for each in np.argsort(first).tolist()]


def still_holds(
    dataset: Dataset, rows: Int[np.ndarray, ' rows'], trusted: Float32[np.ndarray, 'rows cols']
) -> list[Int[np.ndarray, ' pictures']]:
    """`holds_of`, without images in which the tip still moves."""
    known = trusted.reshape(-1) > 0
    return [_at_rest(dataset, each, known) for each in holds_of(dataset, rows)]


def _at_rest(
    dataset: Dataset, rows: Int[np.ndarray, ' pictures'], known: Bool[np.ndarray, ' regions']
) -> Int[np.ndarray, ' pictures']:
    motion = np.nan_to_num(dataset.features[rows].astype(np.float32))
    return np.asarray(rows[still(motion.reshape(len(rows), len(known), -1)[:, known])])


def still(motion: Float[np.ndarray, 'pictures regions channels']) -> Bool[np.ndarray, ' pictures']:
    """Which images of a hold agree with most of its images. Images of a moving or leaving tip differ."""
    if len(motion) < LEAST_TO_TELL:
        return np.ones(len(motion), bool)
    usual = np.median(motion, axis=0)
    size = np.square(usual).sum(axis=-1)
    most = np.argsort(size)[-max(LEAST_REGIONS, round(MOST_MOVED * len(size))) :]
    # The median over regions is used because single regions are sometimes lost in images at rest, too.
    off = np.median(np.hypot.reduce((motion - usual)[:, most], axis=2), axis=1)
    return np.asarray(off <= MOVING * np.median(off))
