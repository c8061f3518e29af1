"""Checks a model's stated uncertainty: coverage of its intervals, and stated against actual errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.learning.evaluation.predictions import Predictions
from tactile_nodes.learning.evaluation.scores import ALL, depths_of
from tactile_nodes.sensing import metrics
from tactile_nodes.shapes import Float

LEVELS = (0.5, 0.68, 0.8, 0.9, 0.95, 0.99)


@dataclass(frozen=True)
class Uncertainty:
    """How well a model's standard deviations of one quantity (N, or mm along each axis) match its errors.

    `coverage` is that of the 90 % interval by group of presses. `levels` is that of other intervals over all presses.
    `curve` holds stated against actual errors.
    """

    unit: str
    coverage: dict[str, float]
    levels: dict[str, float]
    curve: tuple[metrics.UncertaintyBin, ...]


def force_uncertainty(found: Predictions) -> Uncertainty | None:
    """Uncertainty of the total force, over presses; None if the model states none."""
    chosen = found[found.touched & ~np.isnan(found.total_sigma_n)]
    if not len(chosen):
        return None
    return _judge('N', chosen.force_error_n[:, None], chosen.total_sigma_n, chosen.depth_mm)


def position_uncertainty(found: Predictions) -> Uncertainty | None:
    """Uncertainty of the place along each axis, over presses; None if the model states none."""
    placed = ~np.isnan(found.position_sigma_mm) & ~np.isnan(found.away_mm)
    chosen = found[found.touched & placed]
    if not len(chosen):
        return None
    return _judge('mm', chosen.place_error_mm, chosen.position_sigma_mm, chosen.depth_mm)


def _judge(
    unit: str,
    errors: Float[np.ndarray, 'samples axes'],
    sigma: Float[np.ndarray, ' samples'],
    depth_mm: Float[np.ndarray, ' samples'],
) -> Uncertainty:
    # The root mean square over the axes has the same scale as the standard deviation stated for each axis.
    size = np.sqrt(np.mean(errors**2, axis=1))
    each = np.broadcast_to(sigma[:, None], errors.shape)
    groups = {ALL: np.ones(len(sigma), bool), **depths_of(depth_mm)}
    return Uncertainty(
        unit=unit,
        coverage={name: metrics.coverage(errors[who], each[who]) for name, who in groups.items() if who.any()},
        levels={f'{level:.0%}': metrics.coverage(errors, each, level) for level in LEVELS},
        curve=tuple(metrics.binned_uncertainty(size, sigma)),
    )
