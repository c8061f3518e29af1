"""Learn the prior of calibration errors of a source model from calibrations for other gels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_nodes.learning.axisymmetric.calibration import Judged, correcting
from tactile_nodes.learning.datasets.pressed_gels import first_presses
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.transfer.fit import OtherGel
from tactile_nodes.sensing.explain.axisymmetric.prior import ErrorPrior
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.shapes import Float

COUNTS = 10, 25, 50, 100


Found = tuple[Float[np.ndarray, 'n 3'], Float[np.ndarray, 'n 3']]
"""Estimates of presses, and the truth: x, y and force, in units of the source's gel."""


def found_by_counts(
    source: AxisymmetricReadout, planned: Dataset, anywhere: Dataset, counts: Sequence[int] = COUNTS
) -> list[Found]:
    """Estimates of presses anywhere on a gel, from calibrations with the first presses of the plan, by their number."""
    judged = [_judged(source, first_presses(planned, count), anywhere) for count in counts]
    return [(each.found / each.readout.unit, each.truth / each.readout.unit) for each in judged]


def learned_prior(
    source: AxisymmetricReadout, gels: Sequence[Sequence[Found]], counts: tuple[int, ...] = COUNTS
) -> ErrorPrior:
    """The prior from the results of `found_by_counts` for several gels.

    Random errors from the regions of a single gel average out over the gels.
    """
    terms = []
    for of_count in zip(*gels, strict=True):
        found, truth = (np.concatenate(each) for each in zip(*of_count, strict=True))
        terms.append(correcting(found, truth, source.correction))
    return ErrorPrior(counts, np.stack(terms))


def _judged(source: AxisymmetricReadout, few: Dataset, anywhere: Dataset) -> Judged:
    """Evaluate a calibration with a few presses on other presses of the same gel, without any correction."""
    other = OtherGel.of(source, few)
    response = other.regions(other.whole().response)
    nothing = replace(source.correction, terms=np.zeros_like(source.correction.terms), local=None)
    readout = replace(other.readout(response, source.doubt), correction=nothing)
    return Judged.of(readout, anywhere, np.flatnonzero(anywhere.presses[:, 2] > 0))
