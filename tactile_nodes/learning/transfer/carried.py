"""The prior of the errors: what calibrations that begin with one model get wrong alike, learned from other gels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tactile_nodes.learning.axisymmetric.calibration import Judged, correcting
from tactile_nodes.learning.datasets.pressed_gels import first_presses
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.transfer.fit import OtherGel
from tactile_nodes.sensing.explain.axisymmetric.carried import Carried
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout

COUNTS = 10, 25, 50, 100


Found = tuple[Float[np.ndarray, 'n 3'], Float[np.ndarray, 'n 3']]
"""What was found of presses, and the truth: x, y and force, in distances and forces of the source's gel."""


def found_by_counts(
    source: AxisymmetricReadout, planned: Dataset, anywhere: Dataset, counts: Sequence[int] = COUNTS
) -> list[Found]:
    """Presses anywhere on a gel, by calibrations with so many of the first of those that were planned."""
    judged = [_judged(source, first_presses(planned, count), anywhere) for count in counts]
    return [(each.found / each.readout.unit, each.truth / each.readout.unit) for each in judged]


def learned_carried(
    source: AxisymmetricReadout, gels: Sequence[Sequence[Found]], counts: tuple[int, ...] = COUNTS
) -> Carried:
    """From what `found_by_counts` tells of some gels.

    What regions of one gel add by chance to its errors falls away in the mean over the gels.
    """
    terms = []
    for of_count in zip(*gels, strict=True):
        found, truth = (np.concatenate(each) for each in zip(*of_count, strict=True))
        terms.append(correcting(found, truth, source.correction))
    return Carried(counts, np.stack(terms))


def _judged(source: AxisymmetricReadout, few: Dataset, anywhere: Dataset) -> Judged:
    """A calibration by a few presses on other presses of the same gel, corrected by nothing."""
    other = OtherGel.of(source, few)
    response = other.regions(other.whole().response)
    nothing = replace(source.correction, terms=np.zeros_like(source.correction.terms), local=None)
    readout = replace(other.readout(response, source.doubt), correction=nothing)
    return Judged.of(readout, anywhere, np.flatnonzero(anywhere.presses[:, 2] > 0))
