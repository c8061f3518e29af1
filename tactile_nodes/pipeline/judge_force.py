"""The status of a force: reasons to doubt it, whether anything touches, and how far the force may be off."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.pipeline.ready_model import Ready
from tactile_nodes.pipeline.reasons import ALTERED, INVALID, UNMEASURED, WITHOUT_A_NUMBER
from tactile_nodes.sensing.explain.likeness import known
from tactile_nodes.sensing.explain.model import OK_TIMES, ForceMap
from tactile_nodes.sensing.explain.reading import Contact
from tactile_nodes.sensing.judge.stamped import ByStamp
from tactile_nodes.sensing.picture.quality import ContactDetector

FORCE = types.ForceDistribution

KNOWN_SHARE = 0.99
"""Least share of the known regions that undisturbed frames show."""

LEAST_CONFIDENCE = 0.85
"""Share of the known regions that a live launch requires (config/live.yaml)."""

LEAST_DOUBT_N = 0.05

KNOCKED_SHARE = 0.1
"""Error after a knock, as a share of the total, and of the least force that counts as a contact."""

ALTERED_SHARE = {FORCE.REASON_LIGHT_CHANGED: 0.02, FORCE.REASON_BLURRED: 0.02, ALTERED: 0.15}
"""The same for an image with other light, for one that is less sharp or noisier, and for one that is both. A blur of
1 px reads 2 % too little once the rest image has it too. JPEG of quality 30, which is both, reads a seventh too little,
and a blur of half a pixel that the rest image does not have, which counts as both, a tenth."""

BEGINNING_SHARE = 0.1
"""Error of a force whose contact began within the exposure, as a share of the force (standard deviation).

The image is the mean of an exposure in which the force rose from zero, so that the error is half of it at most, to
either side. Neither the image itself nor earlier frames show this; the next frame does.
"""


class ForceMemory:
    """State of earlier forces: whether anything touched, and the total while nothing did.

    `calibration` are the reasons added by the state of the calibration, by stamp.
    """

    def __init__(self, threshold_n: float) -> None:
        self.contact = ContactDetector(threshold_n)
        self.free_n: float | None = None
        self.calibration = ByStamp(0)


@dataclass(frozen=True)
class Judged:
    """Standard deviation of the total with all that is known of the frame, its status, and the reasons if not ok."""

    sigma_n: float
    status: int
    reasons: int


def judge_force(
    memory: ForceMemory, ready: Ready, features: types.FlowFeatures, found: ForceMap, least_confidence: float
) -> tuple[Judged, tuple[Contact, ...]]:
    """Judge the force that a model found; seeing a smaller share of regions than `least_confidence` is a reason.

    Returns the verdict, and the contacts to report: none while nothing touches.
    """
    reasons = int(features.reasons | ready.reasons | _reasons(ready, features, found, least_confidence))
    touching, begun_n = _contact(memory, found, reasons)
    reasons |= memory.calibration.at(stamp_ns(features.header.stamp))
    verdict = judged(found, reasons, begun_n, unsure_of=ready.unsure_of)
    return verdict, _touching(memory, found) if touching else ()


def _reasons(ready: Ready, features: types.FlowFeatures, found: ForceMap, least_confidence: float) -> int:
    reasons = found_reasons(found, least_confidence)
    if features.reasons & UNMEASURED:
        reasons &= ~FORCE.REASON_NOT_FINITE
    if features.untouched:
        reasons &= ~FORCE.REASON_UNLIKE_TRAINING
    if (features.image_width, features.image_height) != ready.inputs.image_size:
        reasons |= FORCE.REASON_OTHER_IMAGE
    return int(reasons)


def _contact(memory: ForceMemory, found: ForceMap, reasons: int) -> tuple[bool, float]:
    """Whether anything touches, and by how much the force grew since the last frame in which nothing did."""
    before_n, memory.free_n = memory.free_n, None
    if reasons & INVALID:
        return False, 0.0
    touching = memory.contact.update(found.total_n)
    if not touching:
        memory.free_n = found.total_n
    return touching, found.total_n - before_n if touching and before_n is not None else 0.0


def _touching(memory: ForceMemory, found: ForceMap) -> tuple[Contact, ...]:
    """The strongest contact, and all others above the threshold."""
    least_n = memory.contact.threshold_n
    return (found.contacts[0], *(each for each in found.contacts[1:] if each.force_n >= least_n))


def found_reasons(found: ForceMap, least_confidence: float = LEAST_CONFIDENCE) -> int:
    """Reasons from the force itself: not a number, too few regions seen, novelty."""
    tips_alone = found.contacts if found.acting is None else ()  # a field has compared tips with other contacts
    faults = {
        FORCE.REASON_NOT_FINITE: not math.isfinite(found.total_n),
        FORCE.REASON_LOW_CONFIDENCE: found.confidence < least_confidence,
        FORCE.REASON_UNLIKE_TRAINING: not known(found.unlikeness, tips_alone),
    }
    return sum(bit for bit, present in faults.items() if present)


def judged(found: ForceMap, reasons: int, begun_n: float = 0.0, *, unsure_of: int = 0) -> Judged:
    """How far a force may be off. It is ok within twice the model's usual error.

    `reasons` are those of the frame. `begun_n` is the force that began in it. `unsure_of` are further reasons after
    which the error of the model is unknown.

    The model's uncertainty grows with the novelty (`unlikeness`) above 1, as errors do, and with the share of lost
    regions, since a press there is not seen. Reasons that do not change the status are left out. If the model itself
    is too uncertain, the frame is `UNLIKE_TRAINING`. The standard deviation is NaN if the model states none; then any
    reason counts.
    """
    stated_n = found.total_sigma_n * (found.unlikeness if found.unlikeness > 1 else 1.0)
    at_most_n = abs(found.total_n) + LEAST_DOUBT_N
    knocked, altered = bool(reasons & FORCE.REASON_FOREIGN_MOTION), reasons & ALTERED
    off_n = {
        FORCE.REASON_LOW_CONFIDENCE: max(0.0, KNOWN_SHARE - found.confidence) * at_most_n,
        FORCE.REASON_FOREIGN_MOTION: KNOCKED_SHARE * at_most_n * knocked,
        altered: ALTERED_SHARE.get(altered, 0.0) * at_most_n,
        FORCE.REASON_BEGINNING: BEGINNING_SHARE * begun_n,
    }
    sigma_n, limit_n = math.hypot(stated_n, *off_n.values()), OK_TIMES * found.nominal_n
    if reasons & (INVALID | FORCE.REASON_CALIBRATION_INVALID):
        return Judged(sigma_n, FORCE.STATUS_INVALID, reasons)
    unsure = sigma_n > limit_n or (math.isnan(sigma_n) and bool(reasons))
    if not unsure and not reasons & (WITHOUT_A_NUMBER | unsure_of):
        return Judged(sigma_n, FORCE.STATUS_OK, 0)
    reasons |= sum(reason for reason, each in off_n.items() if each > 0 and math.hypot(stated_n, each) > limit_n)
    return Judged(sigma_n, FORCE.STATUS_DEGRADED, int(reasons or FORCE.REASON_UNLIKE_TRAINING))


def judged_alone(found: ForceMap) -> Judged:
    """The same from the force alone, as for an undisturbed image."""
    return judged(found, found_reasons(found))
