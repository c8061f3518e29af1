"""Does a model flag inputs that it was not made for, and how wrong is it where it does not?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.learning.evaluation.predictions import Predictions
from tactile_nodes.learning.evaluation.scores import percentile, share
from tactile_nodes.sensing import metrics


@dataclass(frozen=True)
class UnlikeScores:
    """What a model says of disturbed inputs.

    `flagged` and `rest_flagged` are shares of presses and of frames at rest (NaN: the model cannot tell). What is not
    flagged is taken at its word: `unflagged_rmse_n` and `unflagged_p95_mm` are its errors, `false_contacts` the share
    of all frames at rest that are a contact to it. `rmse_n` is over all presses, flagged or not,
    `regions_seen` the median share of the known regions in which the flow still finds markers.
    """

    presses: int
    flagged: float
    rest_flagged: float
    false_contacts: float
    unflagged_rmse_n: float
    unflagged_p95_mm: float
    rmse_n: float
    unlikeness_median: float
    regions_seen: float


def score_unlike(found: Predictions) -> UnlikeScores:
    """Scores over the samples of one disturbance."""
    presses, rest = found[found.touched], found[~found.touched]
    believed = presses[~presses.flagged]
    away = believed.away_mm[np.isfinite(believed.away_mm)]
    tells = bool(np.isfinite(found.unlikeness).any())
    return UnlikeScores(
        presses=len(presses),
        flagged=share(presses.flagged) if tells else float('nan'),
        rest_flagged=share(rest.flagged) if tells else float('nan'),
        false_contacts=share(rest.detected & ~rest.flagged),
        unflagged_rmse_n=metrics.root_mean_square(believed.force_error_n),
        unflagged_p95_mm=percentile(away, 95),
        rmse_n=metrics.root_mean_square(presses.force_error_n),
        unlikeness_median=float(np.median(presses.unlikeness)) if tells else float('nan'),
        regions_seen=percentile(found.regions_seen, 50),
    )
