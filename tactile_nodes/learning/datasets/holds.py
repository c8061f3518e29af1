"""Pictures of a press that is held still: which belong together, and which of them show it at rest."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from tactile_nodes.learning.datasets.simulated import Dataset

LEAST_TO_TELL = 3
"""Of two pictures that differ nobody knows which one shows the press at rest."""
MOVING = 2.0
"""Times as far from the hold's median as pictures are that only noise tells apart."""
MOST_MOVED = 0.1
"""Share of the regions, those that a press moves most, which tell whether the tip rests."""
LEAST_REGIONS = 20
"""Of these at least: the median of their distances is known to a seventh then."""


def holds_of(dataset: Dataset, rows: Int[np.ndarray, ' rows']) -> list[Int[np.ndarray, ' pictures']]:
    """Of some samples those that show one press each, in the order of the presses' first pictures."""
    if dataset.hold is None:
        return list(rows[:, None])
    _, first, number = np.unique(dataset.hold[rows], return_index=True, return_inverse=True)
    order = np.argsort(number, kind='stable')
    together = np.split(rows[order], np.flatnonzero(np.diff(number[order])) + 1)
    return [together[each] for each in np.argsort(first).tolist()]


def still_holds(
    dataset: Dataset, rows: Int[np.ndarray, ' rows'], trusted: Float32[np.ndarray, 'rows cols']
) -> list[Int[np.ndarray, ' pictures']]:
    """`holds_of`, without pictures in which the tip still moves."""
    known = trusted.reshape(-1) > 0
    return [_at_rest(dataset, each, known) for each in holds_of(dataset, rows)]


def _at_rest(
    dataset: Dataset, rows: Int[np.ndarray, ' pictures'], known: Bool[np.ndarray, ' regions']
) -> Int[np.ndarray, ' pictures']:
    motion = np.nan_to_num(dataset.features[rows].astype(np.float32))
    return np.asarray(rows[still(motion.reshape(len(rows), len(known), -1)[:, known])])


def still(motion: Float[np.ndarray, 'pictures regions channels']) -> Bool[np.ndarray, ' pictures']:
    """Which pictures of a hold show what most of them do; a tip that still moves, or leaves, shows something else."""
    if len(motion) < LEAST_TO_TELL:
        return np.ones(len(motion), bool)
    usual = np.median(motion, axis=0)
    size = np.square(usual).sum(axis=-1)
    most = np.argsort(size)[-max(LEAST_REGIONS, round(MOST_MOVED * len(size))) :]
    # The median over regions, since single ones are lost now and then in a picture at rest, too.
    off = np.median(np.hypot.reduce((motion - usual)[:, most], axis=2), axis=1)
    return np.asarray(off <= MOVING * np.median(off))
