"""What reasons say of a force: whether it may be used, and how far it may be off."""

from __future__ import annotations

import math

from tactile_nodes.messages import types
from tactile_nodes.sensing.model import ForceMap

FORCE = types.ForceDistribution

KNOWN_SHARE = 0.99
"""Share of the known regions that undisturbed frames show at least."""

LEAST_DOUBT_N = 0.05

UNMEASURED = (
    FORCE.REASON_NO_REFERENCE | FORCE.REASON_OTHER_IMAGE | FORCE.REASON_DARK_IMAGE | FORCE.REASON_SATURATED_IMAGE
)
"""Nothing is known of such a frame: its numbers are NaN."""

ALTERED = FORCE.REASON_LIGHT_CHANGED | FORCE.REASON_BLURRED
"""Regions of such a picture show motion a little other than those that a model learned from."""

INVALID = UNMEASURED | FORCE.REASON_NOT_FINITE | FORCE.REASON_PICTURE_LOST

SHARE_IN_DOUBT = {
    FORCE.REASON_LOW_CONFIDENCE: 0.1,
    FORCE.REASON_FOREIGN_MOTION: 0.1,
    FORCE.REASON_LIGHT_CHANGED: 0.3,
    FORCE.REASON_BLURRED: 0.3,
}
"""Share of the total, and of the least force called a contact, that it may be off by for a reason."""


BEGINNING_SHARE = 0.1
"""Share of the force by which it is off where contact began within the exposure, as a standard deviation.

The picture is the mean of an exposure in which force came from nothing: by half of it to either side at most. Nothing
in one picture tells, and frames before it do not, either; the next one does.
"""

DOUBTFUL = 2.0
"""Times the uncertainty that the model states by itself, from which a force is not ok."""


def told_sigma_n(found: ForceMap, reasons: int, begun_n: float = 0.0) -> tuple[float, int]:
    """The standard deviation of the total with what the model cannot know, and the reason if that is most of it.

    It is NaN where the model states none. It grows with the unlikeness above 1, as errors do, with the share of the
    regions that are lost (what presses there is not seen), with `begun_n` that began in this frame, and for light, blur
    and knocks by shares that stand for the errors in docs/results/stability.md.
    """
    stated_n = found.total_sigma_n * (found.unlikeness if found.unlikeness > 1 else 1.0)
    at_most_n = abs(found.total_n) + LEAST_DOUBT_N
    told = [share * at_most_n for reason, share in SHARE_IN_DOUBT.items() if reasons & reason]
    untold = {
        FORCE.REASON_LOW_CONFIDENCE: max(0.0, KNOWN_SHARE - found.confidence) * at_most_n,
        FORCE.REASON_BEGINNING: BEGINNING_SHARE * begun_n,
    }
    unsure = sum(reason for reason, off_n in untold.items() if math.hypot(stated_n, off_n) > DOUBTFUL * stated_n)
    return math.hypot(stated_n, *told, *untold.values()), int(unsure)


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


def status_of(reasons: int) -> int:
    """What some reasons make of a force: ok, degraded or invalid."""
    if reasons & (INVALID | FORCE.REASON_CALIBRATION_INVALID):
        return FORCE.STATUS_INVALID
    return FORCE.STATUS_DEGRADED if reasons else FORCE.STATUS_OK


STAYS_NS = 400_000_000
"""No longer: a contact that rolls on may well become one that is known."""


class StillUnlike:
    """Whether a contact was called unlike the training a moment ago: what presses is no other body since.

    Noise alone decides of single frames of a contact near the limit, and now and then of a wrong force that it is ok.
    """

    def __init__(self) -> None:
        self._seen_ns: int | None = None

    def told(self, stamp_ns: int, *, unlike: bool, touching: bool) -> bool:
        """Whether a frame is to be called unlike: it is itself, or one of the same contact was in the last 0.4 s."""
        if not touching:
            self._seen_ns = None
        elif unlike:
            self._seen_ns = stamp_ns
        return unlike or (self._seen_ns is not None and 0 <= stamp_ns - self._seen_ns <= STAYS_NS)
