"""Learn from several other gels what calibrations that begin with one model get wrong alike."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tactile_nodes.learning.axisymmetric_calibration import Judged, correcting
from tactile_nodes.learning.axisymmetric_local import interpolated, wrong_by
from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.pressed_gels import first_presses
from tactile_nodes.learning.transfer_fit import OtherGel
from tactile_nodes.sensing.axisymmetric_carried import Carried
from tactile_nodes.sensing.axisymmetric_readout import AxisymmetricReadout, Correction

COUNTS = 10, 25, 50, 100
HARD = 0.15
"""Of the hardest press: shares of lighter ones are mostly noise, and have no say in what is wrong alike at a place."""


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
    corrections = [
        replace(source.correction, terms=correcting(*_pooled(each), source.correction), local=None)
        for each in judged.values()
    ]
    tables = [_left_alike(each, correction) for each, correction in zip(judged.values(), corrections, strict=True)]
    return Carried(counts, np.stack([each.terms for each in corrections]), np.stack(tables))


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


def _left_alike(judged: list[Judged], correction: Correction) -> Float[np.ndarray, 'rows cols 3']:
    """A table of what polynomials leave wrong on all gels alike, between the plan's presses above all.

    It is the mean of a table for each gel. How these scatter says how much of it is chance, and it is drawn to nothing
    by as much (James and Stein, 1961).
    """
    tables = np.stack([_left(each, correction) for each in judged])
    if len(tables) == 1:
        return np.zeros_like(tables[0])
    mean = tables.mean(axis=0)
    chance = tables.var(axis=0, ddof=1).mean(axis=(0, 1)) / len(tables)
    known = 1 - chance / np.maximum(np.square(mean).mean(axis=(0, 1)), 1e-12)
    table: np.ndarray = mean * np.clip(known, 0.0, 1.0)
    return table


def _left(judged: Judged, correction: Correction) -> Float[np.ndarray, 'rows cols 3']:
    """What polynomials leave wrong on one gel."""
    truth = judged.truth / judged.readout.unit
    hard = truth[:, 2] > HARD * correction.hardest_n
    told, truth = correction(judged.found[hard] / judged.readout.unit), truth[hard]
    return interpolated(truth[:, :2], wrong_by(told, truth), np.ones(len(truth), int), correction.reach_mm)
