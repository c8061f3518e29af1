"""What a response becomes as the picture blurs: measured anew, or as the difference to sharp features of each press.

Both features are of one picture, so that much of its noise cancels out of the difference: a few hundred presses tell
it. Of thousands a response measured anew is better. Presses that neither fit saw say which it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_nodes.learning.config import ResponseConfig
from tactile_nodes.learning.datasets.blurred_presses import BlurredPresses
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.measured.calibration import calibrated, rescaled
from tactile_nodes.learning.measured.fit import LEAST_UNTOUCHED, Subspace, at_new_places, inner_held_out
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.measured.blurs import Blur, Blurs
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout

SMOOTHING = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0)
"""Weights of the penalty on curvature that are tried: a difference is smaller beside its noise than a response."""

PRESSES_PER_COMPONENT = 10
"""With fewer presses a difference is more noise than blur."""


def with_blurs(
    readout: ResponseReadout,
    dataset: Dataset,
    blurred: Sequence[BlurredPresses],
    held_out: np.ndarray,
    config: ResponseConfig,
    progress: Progress,
) -> ResponseReadout:
    """The readout with what it becomes in blurred pictures; as it was where these are too few to tell.

    Args:
        readout: what `fit_response` made of `dataset`.
        blurred: its first samples, in pictures less and less sharp.
        held_out: which samples of `dataset` no fit sees.
    """
    if not blurred:
        return readout
    used = np.flatnonzero(~held_out[: len(blurred[0].dataset.presses)])
    touched = dataset.presses[used, 2] > 0
    components = len(readout.whitening)
    if touched.sum() < PRESSES_PER_COMPONENT * components or (~touched).sum() < LEAST_UNTOUCHED:
        progress.say(f'{touched.sum()} presses are too few to tell what blur does to {components} components')
        return readout
    with progress.bar('measuring what blur does', len(blurred)) as bar:
        levels = []
        for each in blurred:
            levels.append(_level(readout, dataset, each, held_out, config))
            bar.advance(1, f'at a sharpness of {each.sharpness:.3f}')
    return replace(readout, blurs=Blurs(blurred[0].sharp, tuple(levels)))


def _level(
    readout: ResponseReadout, dataset: Dataset, presses: BlurredPresses, held_out: np.ndarray, config: ResponseConfig
) -> Blur:
    """What the response is at one sharpness, how noisy and how sure."""
    soft, count = presses.dataset, len(presses.dataset.presses)
    sharp, held_out = dataset.take(np.arange(count)), held_out[:count]
    blurred = Subspace.seen_by(readout, soft)
    apart = replace(blurred, components=blurred.components - Subspace.seen_by(readout, sharp).components)
    used = np.flatnonzero(~held_out & np.isfinite(apart.components).all(axis=1))
    inner = inner_held_out(soft, used, config.seed)
    first, rest = used[~inner], used[inner]
    whitening = readout.whitening.astype(float)
    known = np.linalg.solve(whitening, readout.response.coefficients.reshape(-1, len(whitening)).T.astype(float)).T
    tried = []
    for of, beside in ((apart, known), (blurred, np.zeros_like(known))):
        normal = of.normal(first)
        for weight in SMOOTHING:
            early = beside + normal.solve(weight)
            tried.append((blurred.misfit(rest, early), weight, of, beside, early))
    _, smoothing, of, beside, early = min(tried, key=lambda each: each[0])
    calibration, likeness = calibrated(blurred.readout(first, early, readout.bins), soft, rest)
    coefficients = beside + of.normal(used).solve(smoothing)
    final = blurred.readout(used, coefficients, readout.bins)
    final = replace(final, calibration=calibration, likeness=likeness, most_contacts=readout.most_contacts)
    calibration = rescaled(final, soft, at_new_places(soft, held_out))
    return Blur(
        presses.sharpness,
        ((coefficients - known) @ whitening.T).reshape(readout.response.coefficients.shape).astype(np.float16),
        np.asarray(np.linalg.solve(whitening.T, final.whitening.astype(float).T).T, np.float32),
        final.response.growth,
        calibration,
        likeness.floor,
        likeness.share,
    )
