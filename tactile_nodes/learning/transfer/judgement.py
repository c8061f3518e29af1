"""Whether a model is worth to be written: by presses held out, against the model before and against the mean.

One judgement for calibrations from bags, data sets and pictures, beside a rig, and for models trained on recorded
presses.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.transfer.errors import Errors

TELLING_SHARE, TELLING_MM = 0.2, 1.0
"""Forces that are all within so much of their mean, and places as near to one another, are no measure of a model."""
CHANCE = 1.25
"""By how many times a root mean square may be larger than that of answering the mean: of twelve presses it is known to
a fifth (one over the root of twice as many). Beside the model before the presses are the same, and none may be
larger."""
ADVICE = 'keep the model, check the given places and forces, or press at more places'
POOR = 0.1
"""Of the errors of answering the mean: models of enough presses are at a fiftieth of them."""


def of_the_mean(contacts: Float[np.ndarray, 'n 3']) -> Errors:
    """The errors of one answer to all contacts (x, y in mm, force in N), their mean.

    NaN of what is so much alike that this answer is as good as any. Of forces of 0.2 and 0.6 N they are 0.2 N.
    """
    mean = contacts.mean(axis=0)
    errors = Errors.of(np.asarray(contacts, float) - mean)
    telling_n = errors.force_rmse_n > TELLING_SHARE * mean[2]
    telling_mm = errors.place_median_mm > TELLING_MM
    return Errors(
        errors.force_rmse_n if telling_n else math.nan,
        errors.force_median_n if telling_n else math.nan,
        errors.place_median_mm if telling_mm else math.nan,
    )


def objection(what: str, after: Errors, before: Errors | None, mean: Errors) -> str:
    """Why a model is not worth to be written; empty where it is. `what` it is: 'calibration'.

    Against the model before on balance; by answering the mean neither force nor place may be as good: a table with
    true places and the forces of other presses would give places that make up for any force. Medians do not see the
    few presses that are ruined, as at the rim, and places do not make up for these: no root mean square may be worse
    than before, or by more than chance than by answering the mean.
    """
    for other, words, share, most in (
        (before, 'without', share_of, 1.0), (mean, 'when predicting the mean of all presses', worst_share_of, CHANCE)
    ):  # fmt: skip
        if other is None:
            continue
        if share(after, other) >= 1:
            return (
                f'the {what} would not help: held-out presses are read {told(after)} off with it, '
                f'{told(other)} {words} (medians)'
            )
        if after.force_rmse_n > most * other.force_rmse_n:
            return (
                f'the {what} would not help: the force RMSE of held-out presses is {after.force_rmse_n:.4f} N with it, '
                f'{other.force_rmse_n:.4f} N {words}'
            )
    return ''


def share_of(after: Errors, other: Errors) -> float:
    """Errors as a share of others, on balance of force and place (product of the medians); 0 where nothing compares.

    Medians, since of few presses one alone rules a mean. Anything is better than what reads nothing (NaN), and what
    reads nothing itself is worse than anything.
    """
    return math.prod(shares) if (shares := _shares(after, other)) else 0.0


def worst_share_of(after: Errors, other: Errors) -> float:
    """As `share_of`, of force or place, whichever is worse."""
    return max(_shares(after, other), default=0.0)


def _shares(after: Errors, other: Errors) -> list[float]:
    pairs = [(after.force_median_n, other.force_median_n), (after.place_median_mm, other.place_median_mm)]
    return [_share(own, theirs) for own, theirs in pairs if math.isfinite(theirs)]


def _share(own: float, theirs: float) -> float:
    if not math.isfinite(own):
        return math.inf
    return own / theirs if theirs > 0 else math.inf


def told(errors: Errors) -> str:
    """'0.0310 N and 0.052 mm'; what is not known is left out."""
    parts = []
    if math.isfinite(errors.force_median_n):
        parts.append(f'{errors.force_median_n:.4f} N')
    if math.isfinite(errors.place_median_mm):
        parts.append(f'{errors.place_median_mm:.3f} mm')
    return ' and '.join(parts) or 'an unknown amount'


def require_worth(said: str, advice: str, *, forced: bool, command: str = 'tactile calibrate') -> None:
    """Refuse what there is an objection to, unless it is wanted all the same, as `command` can be told.

    Raises:
        DatasetError: says the objection, and what to do.
    """
    if said and not forced:
        raise DatasetError(f'{said}; {advice} ({command} … --force writes it all the same)')


def unjudged(presses: int, mean: Errors) -> str:
    """Why so many presses cannot judge a model, by the errors of answering their mean; empty where they can."""
    if math.isfinite(mean.force_median_n) or math.isfinite(mean.place_median_mm):
        return ''
    return f'the quality of the model is unknown: the {presses} held-out presses are too few or too similar'


def poor(after: Errors, mean: Errors) -> str:
    """In words that a model is far from what enough presses lead to; empty where it is not."""
    if worst_share_of(after, mean) <= POOR:
        return ''
    return (
        f'held-out presses are read {told(after)} off, when predicting the mean of all presses {told(mean)} (medians)'
    )
