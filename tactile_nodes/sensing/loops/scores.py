"""Scores of a frame's features along principal directions, with missing regions: see `measured.readout.project`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.loops.common import compiled, factorise, substitute


@compiled()
def _inputs(values, confidence, scaling, floor, inputs, missing):
    """As `InputScaling`: fills in the inputs and the missing ones. Returns how many are missing, and how many left."""
    mean, gain, trusted = scaling
    lost, left = 0, 0
    channels = values.shape[0] // confidence.shape[0]
    for region in range(confidence.shape[0]):
        used = trusted[region] if confidence[region] >= floor else np.float32(0)
        known, gone = trusted[region] > 0, confidence[region] < floor
        for i in range(channels * region, channels * (region + 1)):
            inputs[i] = (values[i] - mean[i]) * gain[i] * used
            if known and gone:
                missing[lost] = i
                lost += 1
            elif known:
                left += 1
    return lost, left


@compiled()
def _fill_missing(directions, missing, sure, scores):
    """Correct scores in place for missing inputs by least squares, as in `measured.readout.project`.

    They solve a system with (1 + sure) I - L L', where L is the directions' columns of the missing inputs.
    """
    n = directions.shape[0]
    square, right = np.zeros((n, n)), np.empty(n)
    for i in range(n):
        for j in range(i + 1):
            for lost in missing:
                square[i, j] -= directions[i, lost] * directions[j, lost]
        square[i, i] += 1 + sure
        right[i] = scores[i]
    factorise(square)
    substitute(square, right)
    for i in range(n):
        scores[i] = right[i]


@compiled()
def observed(values, confidence, scaling, directions, floor, sure, scores):
    """As `ResponseReadout.seen`: fills in scores. Returns the residual and the total, NaN with too few inputs."""
    inputs, missing = np.empty(values.shape[0], np.float32), np.empty(values.shape[0], np.int64)
    lost, left = _inputs(values, confidence, scaling, floor, inputs, missing)
    along = np.empty(scores.shape[0], np.float32)
    squared = np.float32(0)
    for i in range(inputs.shape[0]):
        squared += inputs[i] * inputs[i]
    for n in range(along.shape[0]):
        total = np.float32(0)
        for i in range(inputs.shape[0]):
            total += directions[n, i] * inputs[i]
        along[n] = scores[n] = total
    if left < scores.shape[0]:
        return math.nan, math.nan
    if lost:
        _fill_missing(directions, missing[:lost], sure, scores)
    known = 0.0
    for n in range(along.shape[0]):
        known += scores[n] * along[n]
    count = max(inputs.shape[0] - lost, 1)
    return math.sqrt(max(squared - known, 0.0) / count), math.sqrt(squared / count)


@compiled()
def whitened(whitening, scores, components):
    """Convert scores to components with a noise of 1."""
    for n in range(components.shape[0]):
        total = np.float32(0)
        for i in range(scores.shape[0]):
            total += whitening[n, i] * scores[i]
        components[n] = total
