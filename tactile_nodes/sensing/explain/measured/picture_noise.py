"""How noisy a picture is, and by how much that puts a contact off: from what no press explains of two frames.

What the directions of presses leave over of a frame is its noise, and what the gel's response misses of a hard press,
which is many times as much. Of the same contact a moment later the second part is as it was. So the noise is what two
frames in succession differ by in what is left over: half of the mean square is the variance of one of them. A contact
that moves changes mostly what the directions do explain.

Inputs are in units of their noise in training, at rest (`InputScaling`): there the noise is about 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from tactile_nodes.sensing.explain.measured.response import Fit
from tactile_nodes.sensing.explain.reading import UNKNOWN, Contact

if TYPE_CHECKING:
    from tactile_nodes.sensing.explain.measured.readout import ResponseReadout

LIMIT_SIGMAS = 3.09
"""What is left over at rest stays below its limit in all but one of a thousand frames: so many standard deviations."""

FEWEST = 20
"""Inputs left to tell noise by; of fewer it would be off by more than a sixth."""


def left_over(
    readout: ResponseReadout,
    values: Float32[np.ndarray, 'rows cols channels'],
    confidence: Float32[np.ndarray, 'rows cols'],
    scores: Float32[np.ndarray, ' components'],
) -> Float32[np.ndarray, ' inputs']:
    """What the directions leave over of each input; NaN where it is not known, or where too few are.

    The directions take away their share of the noise, too. It is given back, so that a mean square is that of an input.
    """
    left = readout.scaling(values, confidence).reshape(-1) - readout.likeness.directions.T @ scores
    known = np.repeat(readout.scaling.known(confidence).reshape(-1), values.shape[-1])
    left[~known] = UNKNOWN
    count = int(known.sum())
    free = count - len(scores)
    given_back: np.ndarray = left * np.float32(math.sqrt(count / free) if free >= FEWEST else UNKNOWN)
    return given_back


def noise_between(now: Float32[np.ndarray, ' inputs'], before: Float32[np.ndarray, ' inputs']) -> float:
    """Standard deviation of each input's noise, from what is left over of two frames of one contact; NaN: not known.

    Of (3, 0) and (1, 0) it is 1: the difference of 2 and 0 has a mean square of 2, half of which is either one's.
    """
    apart = now - before
    known = apart[np.isfinite(apart)]
    return math.sqrt(float(known @ known) / (2 * len(known))) if len(known) else UNKNOWN


def usual_noise(readout: ResponseReadout, confidence: Float32[np.ndarray, 'rows cols']) -> float:
    """That of each input in the frames that the readout's components are scaled by, as the limit of these tells it.

    (The limit is of a root mean square over all inputs, silenced ones as well, that lies so far above the usual one.)
    """
    channels = readout.scaling.mean.shape[-1]
    silent = channels * int(readout.scaling.missing(confidence).sum())
    free = channels * int(readout.scaling.known(confidence).sum()) - len(readout.likeness.directions)
    if free < FEWEST:
        return UNKNOWN
    above = 1 + LIMIT_SIGMAS / math.sqrt(2 * free)
    return readout.likeness.floor * math.sqrt((readout.scaling.mean.size - silent) / free) / above


def with_noise(
    contacts: Sequence[Contact],
    readout: ResponseReadout,
    fit: Fit,
    answers: Float[np.ndarray, 'n components'],
    usual: float,
) -> tuple[Contact, ...]:
    """The contacts of a fit, strongest first, with what a noise of 1 in every input puts each of them off by.

    `answers` is by how much place and force (x, y and s of each contact) answer to each component, whose noise is 1
    where that of the inputs is `usual`.
    """
    spread = np.sqrt(np.square(answers).sum(axis=1)).reshape(-1, 3)
    strongest = np.argsort(-fit.contacts[:, 2], kind='stable')
    return tuple(
        replace(
            contact,
            noise_mm=math.hypot(spread[at, 0], spread[at, 1]) / math.sqrt(2) / usual,
            noise_n=readout.response.force_slope(float(fit.contacts[at, 2])) * float(spread[at, 2]) / usual,
        )
        for contact, at in zip(contacts, strongest, strict=True)
    )
