"""Progress of a run, and the remaining time."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence

from tactile_nodes.collection.plan.journal import Journal
from tactile_nodes.collection.plan.plan import Point

BAR = 24
NAMED = 10
NS_PER_S = 1e9


class Progress:
    """Counts attempts and averages their time over the last hundred."""

    def __init__(self, presses: int, done: int) -> None:
        self.presses = presses
        self.done = self.before = done
        self.rejected = 0
        self.last_reason = ''
        self._times: deque[float] = deque(maxlen=100)
        self._since_ns = 0

    def start(self, now_ns: int) -> None:
        self._since_ns = self._since_ns or now_ns

    def note(self, reason: str, begun_ns: int, now_ns: int) -> None:
        """An attempt has ended; `reason` says why it was rejected, if it was."""
        self._times.append((now_ns - begun_ns) / NS_PER_S)
        self.last_reason = reason or self.last_reason
        if reason:
            self.rejected += 1
        else:
            self.done += 1

    @property
    def seconds_each(self) -> float:
        """Mean time of an attempt; 0 before the first."""
        return sum(self._times) / len(self._times) if self._times else 0.0

    @property
    def seconds_left(self) -> float:
        return self.seconds_each * (self.presses - self.done)

    def line(self, now: Point | None) -> str:
        """'[####----] 5476/10952 50.0 %, 3 rejected, press 17 at (1.50, -3.00) 0.75 mm, 5.1 s each, 7 h 46 min left'"""
        filled = BAR * self.done // self.presses
        bar, percent = '#' * filled + '-' * (BAR - filled), 100 * self.done / self.presses
        parts = [f'[{bar}] {self.done}/{self.presses} {percent:.1f} %']
        if self.rejected:
            parts.append(f'{self.rejected} rejected')
        if now is not None:
            parts.append(f'press {now.press} at ({now.x_mm:.2f}, {now.y_mm:.2f}) {now.depth_mm:.2f} mm')
        if self._times:
            parts += [f'{self.seconds_each:.1f} s each', f'{duration(self.seconds_left)} left']
        return ', '.join(parts)

    def summary(self, journal: Journal) -> str:
        """'10952 of 10952 presses recorded, 10952 of them now; 2 attempts rejected (2 x the camera …)'"""
        text = f'{self.done} of {self.presses} presses recorded, {self.done - self.before} of them now'
        if aside := journal.aside:
            text += f'; {len(aside)} set aside until the next run ({_listed(aside)})'
        if not self.rejected:
            return text
        reasons = Counter(entry.reason.split(':')[0] for entry in journal.rejected[-self.rejected :])
        most_common = '; '.join(f'{count} x {reason}' for reason, count in reasons.most_common(3))
        return f'{text}; {self.rejected} attempts rejected ({most_common})'


def _listed(presses: Sequence[int]) -> str:
    """'press 3, 17, 20 and 4 more'"""
    named, more = presses[:NAMED], len(presses) - NAMED
    return f'press {", ".join(map(str, named))}' + (f' and {more} more' if more > 0 else '')


def duration(seconds: float) -> str:
    """3725 is '1 h 2 min', 125 is '2 min 5 s'."""
    total_s = round(seconds)
    if total_s >= 3600:
        return f'{total_s // 3600} h {total_s % 3600 // 60} min'
    return f'{total_s // 60} min {total_s % 60} s' if total_s >= 60 else f'{total_s} s'
