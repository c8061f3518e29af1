"""Scores of a stream's force messages: errors, false and missed contacts, and the reaction of the status."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.stability.stream import AFTER, CAPTURE, HELD, REST, Change, ForceTables, Moment, force_n
from tactile_nodes.messages import types

FORCE = types.ForceDistribution
OK, DEGRADED, INVALID = FORCE.STATUS_OK, FORCE.STATUS_DEGRADED, FORCE.STATUS_INVALID
REASONS = {
    value: name.removeprefix('REASON_').lower().replace('_', ' ')
    for name, value in vars(FORCE).items()
    if name.startswith('REASON_')
}


@dataclass(frozen=True)
class Answer:
    """One frame: the truth, and the reported values."""

    moment: Moment
    true_n: float
    status: int
    reasons: int
    total_n: float
    sigma_n: float
    in_contact: bool
    contacts_mm: tuple[tuple[float, float], ...]
    nominal_n: float = math.nan

    @classmethod
    def of(
        cls,
        moment: Moment,
        message: types.ForceDistribution,
        tables: ForceTables,
        nominal_n: float = math.nan,
    ) -> Answer:
        """An answer from a force message, with the usual error of such a force."""
        places = tuple((each.position.x * 1e3, each.position.y * 1e3) for each in message.contacts)
        return cls(
            moment, force_n(moment, tables), message.status, message.reasons, message.total, message.total_sigma,
            message.in_contact, places, nominal_n,
        )  # fmt: skip

    @property
    def error_n(self) -> float:
        return self.total_n - self.true_n

    @property
    def times(self) -> float:
        """The error relative to the nominal one."""
        return self.error_n / self.nominal_n

    @property
    def reports_a_cause(self) -> bool:
        """Whether it is not ok for another reason than the beginning of contact, which occurs in every stream."""
        return self.status != OK and self.reasons != FORCE.REASON_BEGINNING

    @property
    def true_mm(self) -> list[tuple[float, float]]:
        return [(each.x_mm + each.shift_mm[0], each.y_mm + each.shift_mm[1]) for each in self.moment.touching]


@dataclass(frozen=True)
class Score:
    """The scores of a stream during its disturbance; None if there are no frames for a score.

    `rmse_n` is over held frames, `rmse_ok_n` over those with status ok, and `worst_ok_n` is the largest error of these.
    `times` and `times_ok` are the same relative to the nominal error (root mean square). `first_rmse_n` is over the
    first held frame of each press, so it has the accuracy of a single picture. `error_sigmas` is the error relative to
    the stated uncertainty. `place_mm` is the median over contacts. `missed` is the share of true contacts without a
    reported one. `rest_n` is the largest force reported at rest, `false_n` the largest of those reported as a contact
    (0: none), and `false_share` their share. Shares of statuses are over all frames. `until_said` counts frames from
    the cause to the first with `Answer.said`; `until_invalid` to the first that is invalid (1: at once; a growing
    disturbance counts from `Change.beyond` on). `until_left` is the number of the last invalid frame after the end of
    the disturbance (0: none); None if it does not end.
    """

    rmse_n: float | None
    first_rmse_n: float | None
    rmse_ok_n: float | None
    worst_ok_n: float | None
    place_mm: float | None
    missed: float
    missed_ok: float | None
    rest_n: float | None
    false_n: float
    false_ok_n: float
    false_share: float
    without_number: float
    ok: float
    degraded: float
    invalid: float
    held_ok: float
    held_invalid: float
    sigma_n: float | None
    error_sigmas: float | None
    until_said: int | None
    until_invalid: int | None
    until_left: int | None
    reasons: dict[str, float]
    times: float | None = None
    times_ok: float | None = None


def score(answers: Sequence[Answer], change: Change | None = None) -> Score:
    """Score a stream over the frames with the change; over all frames if it does not end."""
    change = change or Change()
    endless = change.endless
    during = [each for each in answers if (each.moment.kind != CAPTURE if endless else change.acts(each.moment))]
    held = [each for each in during if each.moment.kind == HELD]
    rest = [each for each in during if each.moment.kind == REST]
    held_ok, rest_ok = ([each for each in some if each.status == OK] for some in (held, rest))
    caused = next((n for n, each in enumerate(during) if not change.contact or each.moment.touching), 0)
    since, after = during[caused:], [each for each in answers if each.moment.part == AFTER]
    beyond = next((n for n, each in enumerate(since) if change.beyond(each.moment)), 0)
    return Score(
        rmse_n=_rms(held),
        first_rmse_n=_rms(_first_of_each_press(held)),
        rmse_ok_n=_rms(held_ok),
        worst_ok_n=_largest([abs(each.error_n) for each in held_ok]),
        place_mm=_place_mm(held),
        missed=_missed(held) or 0.0,
        missed_ok=_missed(held_ok),
        rest_n=_largest([each.total_n for each in rest]),
        false_n=_largest([each.total_n for each in rest if each.in_contact]) or 0.0,
        false_ok_n=_largest([each.total_n for each in rest_ok if each.in_contact]) or 0.0,
        false_share=_share(rest, [each.in_contact for each in rest]),
        without_number=_share(during, [not math.isfinite(each.total_n) for each in during]),
        **{
            name: _share(during, [each.status == status for each in during])
            for name, status in (('ok', OK), ('degraded', DEGRADED), ('invalid', INVALID))
        },
        held_ok=_share(held, [each.status == OK for each in held]),
        held_invalid=_share(held, [each.status == INVALID for each in held]),
        sigma_n=_median([each.sigma_n for each in held]),
        error_sigmas=_rms_of([each.error_n / each.sigma_n for each in held if each.sigma_n > 0]),
        until_said=next((n for n, each in enumerate(since, 1) if each.reports_a_cause), None),
        until_invalid=_first(since[beyond:], (INVALID,)),
        until_left=None if endless else _last(after, (INVALID,)),
        reasons=_reasons(during),
        times=_rms_of([each.times for each in held]),
        times_ok=_rms_of([each.times for each in held_ok]),
    )


def _first_of_each_press(held: Sequence[Answer]) -> list[Answer]:
    first: dict[int, Answer] = {}
    for each in held:
        first.setdefault(each.moment.press, each)
    return list(first.values())


def _rms(answers: Sequence[Answer]) -> float | None:
    return _rms_of([each.error_n for each in answers])


def _rms_of(values: Sequence[float]) -> float | None:
    known = np.array([each for each in values if math.isfinite(each)])
    return float(np.sqrt(np.square(known).mean())) if len(known) else None


def _largest(values: Sequence[float]) -> float | None:
    return max((float(each) for each in values if math.isfinite(each)), default=None)


def _median(values: Sequence[float]) -> float | None:
    known = [each for each in values if math.isfinite(each)]
    return float(np.median(known)) if known else None


def _share(of: Sequence[Answer], which: Sequence[bool]) -> float:
    return sum(which) / len(of) if of else 0.0


def _missed(held: Sequence[Answer]) -> float | None:
    true = sum(len(each.true_mm) for each in held)
    unanswered = sum(max(0, len(each.true_mm) - len(each.contacts_mm)) for each in held)
    return unanswered / true if true else None


def _place_mm(held: Sequence[Answer]) -> float | None:
    return _median([
        min(math.dist(place, estimate) for estimate in each.contacts_mm)
        for each in held if each.contacts_mm
        for place in each.true_mm
    ])  # fmt: skip


def _first(answers: Sequence[Answer], statuses: Sequence[int]) -> int | None:
    return next((number for number, each in enumerate(answers, 1) if each.status in statuses), None)


def _last(answers: Sequence[Answer], statuses: Sequence[int]) -> int:
    return max((number for number, each in enumerate(answers, 1) if each.status in statuses), default=0)


def _reasons(answers: Sequence[Answer]) -> dict[str, float]:
    """Share of frames with each reason, the most frequent first."""
    count = Counter(name for each in answers for bit, name in REASONS.items() if each.reasons & bit)
    return {name: number / len(answers) for name, number in count.most_common()}
