"""The criteria of the stability benchmark: whether the errors of a stream hold, or its status reports the problem."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

WITHIN, TWICE, FALSE_N, SAID_WITHIN, LEFT_WITHIN = 1.5, 2.0, 0.020, 3, 10
HELD_SHARE = 0.9
"""A stream that must hold needs a usable force in at least this share of the held frames."""


@dataclass(frozen=True)
class Point:
    """One profile's score under one level of a disturbance, and that of the undisturbed stream."""

    profile: str
    family: str
    name: str
    unit: str
    level: float
    shall_hold: bool
    score: Mapping[str, Any]
    undisturbed: Mapping[str, Any]

    @property
    def what(self) -> str:
        """'camera shifted, 0.3 px'."""
        return ', '.join(
            each for each in (self.name, f'{self.level:g} {self.unit}'.strip() if self.unit else '') if each
        )

    @property
    def ratio(self) -> float | None:
        """The error relative to the undisturbed one."""
        return _ratio(self.score['rmse_n'], self.undisturbed['rmse_n'])

    @property
    def times_ok(self) -> float | None:
        """Error of frames with status ok, relative to the nominal error; in older results, to the undisturbed error."""
        if 'times_ok' in self.score:
            return float(self.score['times_ok']) if self.score['times_ok'] is not None else None
        return _ratio(self.score['rmse_ok_n'], self.undisturbed['rmse_n'])

    @property
    def sigma_ratio(self) -> float | None:
        return _ratio(self.score['sigma_n'], self.undisturbed['sigma_n'])

    @property
    def holds(self) -> bool:
        """Whether the error is within 1.5 times the undisturbed one, or nominal, and nearly all frames are usable."""
        ratio, times = self.ratio, self.score.get('times')
        near = ratio is not None and (ratio <= WITHIN or (times is not None and times <= 1.0))
        return near and self.score['held_invalid'] <= 1 - HELD_SHARE

    @property
    def silently_wrong(self) -> bool:
        """Whether errors are more than twice the nominal ones while the status is ok."""
        return self.times_ok is not None and self.times_ok > TWICE

    @property
    def falsely_touched(self) -> bool:
        """Whether a contact above 20 mN was reported with status ok, but without contact."""
        false_n: float = self.score['false_ok_n']
        return false_n > FALSE_N


def _ratio(value: float | None, of: float | None) -> float | None:
    return value / of if value is not None and of else None


@dataclass(frozen=True)
class Verdict:
    """The number of points that meet an aim, the number of all its points, and the worst one."""

    held: int
    judged: int
    worst: str = ''


def points_of(result: Mapping[str, Any]) -> list[Point]:
    """Every score of a result."""
    return [
        Point(
            profile, case['family'], case['name'], case['unit'], point['level'], point['level'] in case['held_at'],
            score, result['undisturbed'][profile],
        )
        for case in result['cases']
        for point in case['points']
        for profile, score in point['scores'].items()
    ]  # fmt: skip


Judge = Callable[[Sequence[Point]], Verdict | None]


def _holding(*names: str) -> Judge:
    def judge(points: Sequence[Point]) -> Verdict | None:
        asked = [each for each in points if each.shall_hold and each.name in names]
        return _judged(asked, lambda each: each.holds, lambda each: each.ratio or 0.0, 'x')

    return judge


def _silent(points: Sequence[Point]) -> Verdict | None:
    asked = [each for each in points if each.times_ok is not None]
    return _judged(asked, lambda each: not each.silently_wrong, lambda each: each.times_ok or 0.0, 'x')


def _false(points: Sequence[Point]) -> Verdict | None:
    return _judged(points, lambda each: not each.falsely_touched, lambda each: 1e3 * each.score['false_ok_n'], ' mN')


def _invalid(points: Sequence[Point]) -> Verdict | None:
    asked = [each for each in points if each.score['until_invalid'] is not None]
    return _judged(asked, _soon, lambda each: each.score['until_invalid'], ' frames')


def _soon(point: Point) -> bool:
    after: int = point.score['until_invalid']
    return after <= SAID_WITHIN


def _left(points: Sequence[Point]) -> Verdict | None:
    asked = [
        each for each in points if each.score['until_invalid'] is not None and each.score['until_left'] is not None
    ]
    return _judged(
        asked, lambda each: each.score['until_left'] <= LEFT_WITHIN, lambda each: each.score['until_left'], ' frames'
    )


def _judged(
    points: Sequence[Point], held: Callable[[Point], bool], badness: Callable[[Point], float], unit: str
) -> Verdict | None:
    if not points:
        return None
    worst = max(points, key=badness)
    return Verdict(sum(map(held, points)), len(points), f'worst {badness(worst):.3g}{unit} ({worst.what})')


AIMS: dict[str, Judge] = {
    'camera shifted up to 3 px: error within 1.5x, or nominal': _holding('camera shifted'),
    'camera turned up to 1°: error within 1.5x, or nominal': _holding('camera turned'),
    'light ±30 %: error within 1.5x, or nominal': _holding('brightness'),
    'blur up to 1 px: error within 1.5x, or nominal': _holding('blur'),
    'noise up to 4x: error within 1.5x, or nominal': _holding('noise'),
    'up to 20 % of the markers gone: error within 1.5x, or nominal': _holding('markers gone'),
    'error at most twice the nominal error while the status is ok': _silent,
    'no false contact above 20 mN with status ok': _false,
    'status invalid, if it becomes invalid, within 3 frames of the cause': _invalid,
    'no longer invalid 10 frames after the disturbance ends': _left,
}


def losers(points: Sequence[Point]) -> list[str]:
    """A line of text for each disturbance with points where the sensor is wrong without reporting it, or where it must
    hold and does not."""
    lines: dict[str, list[str]] = {}
    for each in points:
        if loss := _loss(each):
            lines.setdefault(each.name, []).append(f'{each.level:g} {each.unit}'.strip() + f' ({loss})')
    return [f'{name}: {"; ".join(found)}' for name, found in lines.items()]


def _loss(point: Point) -> str:
    losses = []
    if point.silently_wrong:
        losses.append(
            f'{point.times_ok:.1f}x the nominal error with status ok; '
            f'{point.score["held_ok"]:.0%} of held frames are ok'
        )
    if point.falsely_touched:
        losses.append(f'a false contact of {1e3 * point.score["false_ok_n"]:.0f} mN with status ok')
    if point.shall_hold and not point.holds:
        ratio = 'no force' if point.ratio is None else f'{point.ratio:.1f}x the undisturbed error'
        losses.append(f'{ratio}, target 1.5x; {point.score["held_invalid"]:.0%} of held frames are invalid')
    return ', '.join(losses)
