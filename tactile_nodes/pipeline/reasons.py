"""Reasons to doubt a force, in groups."""

from __future__ import annotations

from tactile_nodes.messages import types

FORCE = types.ForceDistribution

UNMEASURED = (
    FORCE.REASON_NO_REFERENCE | FORCE.REASON_OTHER_IMAGE | FORCE.REASON_DARK_IMAGE | FORCE.REASON_SATURATED_IMAGE
)
"""With these nothing is known about the frame: its numbers are NaN."""

ALTERED = FORCE.REASON_LIGHT_CHANGED | FORCE.REASON_BLURRED
"""In such an image regions show slightly other motion than in the training images."""

INVALID = UNMEASURED | FORCE.REASON_NOT_FINITE | FORCE.REASON_PICTURE_LOST

WITHOUT_A_NUMBER = (
    FORCE.REASON_STALE | FORCE.REASON_REST_DOUBTFUL | FORCE.REASON_CALIBRATION_AGEING | FORCE.REASON_UNLIKE_TRAINING
)
"""With these the error of the force is unknown, so that each alone rules out `ok`."""


def calibration_reasons(state: types.CalibrationState) -> int:
    """Reasons that the state of a calibration adds to every force."""
    kind = types.CalibrationState
    by_level = {
        kind.LEVEL_AGEING: FORCE.REASON_CALIBRATION_AGEING,
        kind.LEVEL_INVALID: FORCE.REASON_CALIBRATION_INVALID,
    }
    moved = FORCE.REASON_FOREIGN_MOTION if state.reasons & kind.REASON_PICTURE_MOVED else 0
    dented = FORCE.REASON_REST_DOUBTFUL if state.reasons & kind.REASON_DENTED_REST else 0
    return int(by_level.get(state.level, 0) | moved | dented)
