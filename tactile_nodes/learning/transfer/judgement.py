"""Decide whether a model is worth writing: held-out presses compare it with the previous model and with the mean.

Calibrations from bags, data sets and images, calibrations at a rig, and models trained on recorded presses share these
rules.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.transfer.errors import Errors
from tactile_nodes.shapes import Float

VARIED_SHARE, VARIED_MM = 0.2, 1.0
"""Forces and places that all lie this close to their mean cannot measure the quality of a model."""
CHANCE = 1.25
"""Largest ratio of an RMS error to that of the mean. The RMS of twelve presses is known to a fifth (one over the root
of twice as many). Against the previous model the presses are the same, so no RMS may be larger."""
ADVICE = 'keep the model, check the given places and forces, or press at more places'
POOR = 0.1
"""Share of the errors of the mean. Models fitted to enough presses reach a fiftieth."""


def of_the_mean(contacts: Float[np.ndarray, 'n 3']) -> Errors:
    """The errors if every contact (x, y in mm, force in N) is estimated as their mean.

    They are NaN where the contacts are too similar to judge a model. Forces of 0.2 and 0.6 N give 0.2 N.
    """
    mean = contacts.mean(axis=0)
    errors = Errors.of(np.asarray(contacts, float) - mean)
    varied_n = errors.force_rmse_n > VARIED_SHARE * mean[2]
    varied_mm = errors.place_median_mm > VARIED_MM
    return Errors(
        errors.force_rmse_n if varied_n else math.nan,
        errors.force_median_n if varied_n else math.nan,
        errors.place_median_mm if varied_mm else math.nan,
    )


def objection(name: str, after: Errors, before: Errors | None, mean: Errors) -> str:
    """Why a model is not worth writing; empty if it is. `name` names it: 'calibration'.

    Force and place are compared with the previous model on balance, but with the mean each on its own. Otherwise
    good places could make up for any force, as in a table with true places and the forces of other presses. Medians
    do not show a few bad presses, as at the rim, and good places do not make up for these. So no RMS may be worse
    than before, or worse than that of the mean by more than chance.
    """
    for other, words, share, most in (
        (before, 'without', share_of, 1.0), (mean, 'when predicting the mean of all presses', worst_share_of, CHANCE)
    ):  # fmt: skip
        if other is None:
            continue
        if share(after, other) >= 1:
            return (
                f'the {name} would not help: held-out presses are read {describe_errors(after)} off with it, '
                f'{describe_errors(other)} {words} (medians)'
            )
        if after.force_rmse_n > most * other.force_rmse_n:
            return (
                f'the {name} would not help: the force RMSE of held-out presses is {after.force_rmse_n:.4f} N with it, '
                f'{other.force_rmse_n:.4f} N {words}'
            )
    return ''


def share_of(after: Errors, other: Errors) -> float:
    """Errors relative to others, balanced over force and place (product of the medians); 0 if nothing compares.

    Medians are used because one of few presses can dominate a mean. A model that estimates nothing (NaN) is the worst.
    """
    return math.prod(shares) if (shares := _shares(after, other)) else 0.0


def worst_share_of(after: Errors, other: Errors) -> float:
    """As `share_of`, but for force or place, whichever is worse."""
    return max(_shares(after, other), default=0.0)


def _shares(after: Errors, other: Errors) -> list[float]:
    pairs = [(after.force_median_n, other.force_median_n), (after.place_median_mm, other.place_median_mm)]
    return [_share(own, theirs) for own, theirs in pairs if math.isfinite(theirs)]


def _share(own: float, theirs: float) -> float:
    if not math.isfinite(own):
        return math.inf
    return own / theirs if theirs > 0 else math.inf


def describe_errors(errors: Errors) -> str:
    """'0.0310 N and 0.052 mm'; unknown errors are left out."""
    parts = []
    if math.isfinite(errors.force_median_n):
        parts.append(f'{errors.force_median_n:.4f} N')
    if math.isfinite(errors.place_median_mm):
        parts.append(f'{errors.place_median_mm:.3f} mm')
    return ' and '.join(parts) or 'an unknown amount'


def require_worth(fault: str, advice: str, *, forced: bool, command: str = 'tactile calibrate') -> None:
    """Refuse a model that has an objection, unless forced; `command` is named in the advice.

    Raises:
        DatasetError: says the objection, and what to do.
    """
    if fault and not forced:
        raise DatasetError(f'{fault}; {advice} ({command} … --force writes it all the same)')


def unjudged(presses: int, mean: Errors) -> str:
    """Why these presses cannot judge a model, from the errors of their mean; empty if they can."""
    if math.isfinite(mean.force_median_n) or math.isfinite(mean.place_median_mm):
        return ''
    return f'the quality of the model is unknown: the held-out presses ({presses}) are too few or too similar'


def poor(after: Errors, mean: Errors) -> str:
    """A warning if a model is far from what enough presses achieve; empty if it is not."""
    if worst_share_of(after, mean) <= POOR:
        return ''
    return (
        f'held-out presses are read {describe_errors(after)} off, when predicting the mean of all presses '
        f'{describe_errors(mean)} (medians)'
    )
