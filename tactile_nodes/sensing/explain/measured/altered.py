"""A response read in a picture that is not the training's: of another light or sharpness, with markers gone.

Markers that run into each other, or are lost, show regions another mean of the same motion: each is off by a share of
its own motion, and the more the nearer to the contact; what is badly found, under a speck of dirt, say, by more of it.
So the errors of a frame are those of the training and, beside them, some in proportion to what each region moved; a few
more steps from the contacts that were found make the best of all. It is least squares as before, but components are no
longer independent.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Float32

from tactile_nodes.sensing.explain.measured.picture_noise import left_over, usual_noise, with_noise
from tactile_nodes.sensing.explain.measured.readout import SURE_OF_DIRECTIONS, ResponseReadout
from tactile_nodes.sensing.explain.measured.response import CONVERGED_MM, Fit, damping
from tactile_nodes.sensing.explain.reading import BEYOND_UNLIKENESS, Reading, spread_over_bins
from tactile_nodes.sensing.explain.splines import value_and_slopes

ALTERED_SHARE = 0.02
"""Of a region's motion, by which it is off. With half of it forces in a blurred picture are further off with
`fast`, with twice of it with `accurate`."""

BADLY_FOUND, DOUBT = 0.6, 0.4
"""A region of less confidence is off by more of its motion: by this share where it is not found at all, in proportion.
Regions under dirt, or half without markers, hold back what they move; those that a hard press distorts are as sure as
before. Fitted, as the share above, with presses at places of their own."""

STEPS = 6

LEFT_OVER = 0.22
"""Of a press without noise the middle one of all inputs has as much left over as this times the limit of what is, in
proportion to what was seen. Measured with presses at places of their own: 0.23 of `fast`, 0.21 of `accurate`."""

MIDDLE_SQUARE = 0.4549
"""Median of the square of a normal deviate of variance 1."""

MOST_NOISE = 8.0
"""Variance that noise counts for at most. With more of it less noise is read as force, but more of what the splines
miss, which is wrong in the same way in frame after frame. Fitted, as the share above."""


def read_altered(
    readout: ResponseReadout,
    values: Float32[np.ndarray, 'rows cols channels'],
    confidence: Float32[np.ndarray, 'rows cols'],
    *,
    blurred: bool = False,
    measured: bool = False,
) -> Reading:
    """As the readout reads it, with regions trusted the less the more they moved, and its noise counted.

    Where the readout was `measured` in such pictures, it knows their noise. Beside holes it cannot be asked for, as
    more than noise is left over there, but in a picture that is told `blurred`, which may be as sharp as any and noisy.
    What is unlike the training is told as it was, and the force is no surer.
    """
    plain = readout.read(values, confidence)
    if not plain.contacts[0].force_n > 0:
        return plain
    seen = readout.seen(values, confidence)
    components = np.asarray(readout.whitening @ seen.scores, float)
    left = left_over(readout, values, confidence, seen.scores)
    moved = np.square(readout.scaling(values, confidence).astype(float)).mean(axis=-1)
    doubt = np.square(DOUBT * np.clip(1 - confidence / BADLY_FOUND, 0, 1))
    missing = np.repeat(readout.scaling.missing(confidence).reshape(-1), values.shape[-1])
    asked = not measured and (blurred or not missing.any())
    noise = noise_variance(readout, left, seen.size) if asked else 1.0
    channels = values.shape[-1]
    counted = np.repeat(moved * (ALTERED_SHARE**2 + doubt), channels)
    spread = spread_of(readout, missing, min(noise, MOST_NOISE), counted)
    power = readout.response.power
    begin = np.array([(each.x_mm, each.y_mm, each.force_n**power) for each in plain.contacts])
    fit, answers = _refined(readout, components, begin, spread)
    seen_spread = spread_of(readout, missing, noise, np.repeat(moved * doubt, channels))
    more = np.einsum('nc,cd,nd->n', answers, seen_spread - np.eye(len(spread)), answers).reshape(-1, 3)
    contacts = with_noise(readout.contacts(fit, more), readout, fit, answers, usual_noise(readout, confidence))
    beyond = readout.beyond(fit.contacts)
    return replace(
        plain, normal_force_n=spread_over_bins(contacts, readout.bins), contacts=contacts, left_over=left,
        total_sigma_n=math.hypot(*(each.sigma_n for each in contacts)),
        unlikeness=BEYOND_UNLIKENESS if beyond else plain.unlikeness / math.sqrt(noise),
    )  # fmt: skip


def noise_variance(readout: ResponseReadout, left: Float32[np.ndarray, ' inputs'], size: float) -> float:
    """Variance of an input by noise, in units of that at rest in training: 1 at least.

    It is that of the middle one of all inputs by what directions leave over of them (see `left_over`), without what
    they leave over of a press that is seen with this `size` (root mean square). Of noise of 2 and little of a press it
    is 4.
    """
    known = left[np.isfinite(left)]
    if not len(known):
        return 1.0
    middle = float(np.median(np.square(known))) / MIDDLE_SQUARE
    return max(middle - (LEFT_OVER * readout.likeness.share * size) ** 2, 1.0)


def spread_of(
    readout: ResponseReadout, missing: Bool[np.ndarray, ' inputs'], noise: float, off: Float[np.ndarray, ' inputs']
) -> Float[np.ndarray, 'components components']:
    """Covariance of the components by noise of this variance and by the inputs' own variances `off`.

    Noise of the training makes 1 of each component. What is more of it is as much in each input, and so is what it
    makes more where inputs are missing: there the scores are made of the others.
    """
    directions, whitening = readout.likeness.directions, readout.whitening.astype(float)
    spread, mixing, scores = np.eye(len(whitening)), readout.mixing, np.eye(len(whitening))
    if missing.any():
        lost = directions[:, missing].astype(float)
        scores = np.linalg.inv(np.eye(len(lost)) * (1 + SURE_OF_DIRECTIONS) - lost @ lost.T)
        mixing = whitening @ scores @ directions
    if noise > 1 or missing.any():
        spread += whitening @ (noise * scores - np.eye(len(scores))) @ whitening.T
    spread += (mixing * off) @ mixing.T
    return spread


def _refined(
    readout: ResponseReadout,
    components: Float[np.ndarray, ' components'],
    begin: Float[np.ndarray, 'contacts 3'],
    spread: Float[np.ndarray, 'components components'],
) -> tuple[Fit, Float[np.ndarray, 'n components']]:
    """Gauss-Newton with the covariance of all components: `spread`, and what the splines miss.

    With the fit comes what it answers to each component; its information is that of the same contacts in a picture like
    those of the training.
    """
    response = readout.response
    _, largest, low, high = response.limits_array
    certainty = response.certainty(float(begin[:, 2].max()))
    sure = np.linalg.inv(spread + np.diag(1 / certainty - 1))
    here, granted = begin, damping(len(begin))
    for _ in range(STEPS):
        made = [value_and_slopes(response.axes, response.coefficients, each) for each in here.tolist()]
        left = components - sum(each[0] for each in made)
        slopes = np.concatenate([each[1:] for each in made], dtype=np.float64)
        weighted = slopes @ sure
        information = weighted @ slopes.T
        step = np.linalg.solve(information + granted, weighted @ left).reshape(-1, 3)
        moved = np.clip(here + np.clip(step, -largest, largest), low, high)
        done = np.abs(moved - here).max() < CONVERGED_MM
        here = moved
        if done:
            break
    fit = Fit(here, (slopes * certainty) @ slopes.T, float(left @ sure @ left) / len(components))
    return fit, np.linalg.solve(information + granted, weighted)
