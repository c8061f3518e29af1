"""The status that the force topic would give each estimate (ok, degraded or invalid), and whether it is right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.learning.evaluation.predictions import Predictions
from tactile_nodes.learning.evaluation.scores import share
from tactile_nodes.messages import types
from tactile_nodes.sensing import metrics
from tactile_nodes.sensing.explain.model import OK_TIMES

AT_REST, LIGHT = 'at rest', 'light touches'


@dataclass(frozen=True)
class StatusScores:
    """Shares of frames by status.

    `held` is the share of frames not invalid whose 90 % interval of the total, as published, contains the true value.
    `wrong_while_ok` is the share of the ok frames whose error exceeds the limit for ok: twice the nominal error. Both
    are NaN if there is no such frame, or if the model gives no such values.
    """

    frames: int
    ok: float
    degraded: float
    invalid: float
    held: float
    wrong_while_ok: float


def score_status(found: Predictions) -> StatusScores:
    """Scores over samples."""
    kind = types.ForceDistribution
    ok, usable = found.status == kind.STATUS_OK, found[found.status != kind.STATUS_INVALID]
    limit_n = OK_TIMES * found.nominal_n[ok]
    return StatusScores(
        frames=len(found),
        ok=share(ok),
        degraded=share(found.status == kind.STATUS_DEGRADED),
        invalid=share(found.status == kind.STATUS_INVALID),
        held=metrics.coverage(usable.force_error_n, usable.stated_sigma_n),
        wrong_while_ok=share(np.abs(found.force_error_n[ok]) > limit_n) if np.isfinite(limit_n).all() else float('nan'),
    )
