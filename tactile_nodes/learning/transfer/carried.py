"""The prior of the errors: what calibrations that begin with one model get wrong alike, learned from other gels."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from tactile_nodes.learning.axisymmetric.calibration import Judged, correcting
from tactile_nodes.learning.datasets.pressed_gels import first_presses
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.transfer.fit import OtherGel
from tactile_nodes.sensing.explain.axisymmetric.carried import Carried
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout

COUNTS = 10, 25, 50, 100


def learned_carried(
    source: AxisymmetricReadout,
    gels: Iterable[tuple[Dataset, Dataset]],
    counts: tuple[int, ...] = COUNTS,
    advance: Callable[[], object] = lambda: None,
) -> Carried:
    """From gels pressed as a calibration does, and anywhere to judge by; after so many of the first of those presses.

    What regions of one gel add by chance to its errors falls away in the mean over the gels.
    """
    judged: dict[int, list[Judged]] = {count: [] for count in counts}
    for planned, anywhere in gels:
        for count, so_far in judged.items():
            so_far.append(_judged(source, first_presses(planned, count), anywhere))
        advance()
    terms = [correcting(*_pooled(each), source.correction) for each in judged.values()]
    return Carried(counts, np.stack(terms))


def _judged(source: AxisymmetricReadout, few: Dataset, anywhere: Dataset) -> Judged:
    """A calibration by a few presses on other presses of the same gel, corrected by nothing."""
    other = OtherGel.of(source, few)
    response = other.regions(other.whole('whole').response)
    nothing = replace(source.correction, terms=np.zeros_like(source.correction.terms), local=None)
    readout = replace(other.readout(response, source.doubt), correction=nothing)
    return Judged.of(readout, anywhere, np.flatnonzero(anywhere.presses[:, 2] > 0))


def _pooled(judged: list[Judged]) -> tuple[np.ndarray, np.ndarray]:
    """What was found, and the truth, in distances and forces of the source's gel."""
    found = np.concatenate([each.found / each.readout.unit for each in judged])
    return found, np.concatenate([each.truth / each.readout.unit for each in judged])
