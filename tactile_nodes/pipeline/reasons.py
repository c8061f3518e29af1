"""Reasons to doubt a force, in groups."""

from __future__ import annotations

from tactile_nodes.messages import types

FORCE = types.ForceDistribution

UNMEASURED = (
    FORCE.REASON_NO_REFERENCE | FORCE.REASON_OTHER_IMAGE | FORCE.REASON_DARK_IMAGE | FORCE.REASON_SATURATED_IMAGE
)
"""Nothing is known of such a frame: its numbers are NaN."""

ALTERED = FORCE.REASON_LIGHT_CHANGED | FORCE.REASON_BLURRED
"""Regions of such a picture show motion a little other than those that a model learned from."""

INVALID = UNMEASURED | FORCE.REASON_NOT_FINITE | FORCE.REASON_PICTURE_LOST

WITHOUT_A_NUMBER = (
    FORCE.REASON_STALE | FORCE.REASON_REST_DOUBTFUL | FORCE.REASON_CALIBRATION_AGEING | FORCE.REASON_UNLIKE_TRAINING
)
"""By how much a force is off for these nobody can say, so they alone are enough not to call it ok."""


def calibration_reasons(state: types.CalibrationState) -> int:
    """What a calibration's state adds to the reasons of every force."""
    kind = types.CalibrationState
    by_level = {
        kind.LEVEL_AGEING: FORCE.REASON_CALIBRATION_AGEING,
        kind.LEVEL_INVALID: FORCE.REASON_CALIBRATION_INVALID,
    }
    moved = FORCE.REASON_FOREIGN_MOTION if state.reasons & kind.REASON_PICTURE_MOVED else 0
    dented = FORCE.REASON_REST_DOUBTFUL if state.reasons & kind.REASON_DENTED_REST else 0
    return int(by_level.get(state.level, 0) | moved | dented)
