"""Matches the edges of two lists, when some are missing, doubled or moved, and the clocks differ.

Short runs of the device's edges vote for an offset: at the right one, nearly all edges of a run find a partner. From
there the match grows in both directions. The line through the edges matched so far predicts the next ones. So the
drift, which would separate the ends of a long run, is estimated on the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Bool, Float64, Int64

NS_PER_S = 1_000_000_000
RUN = 48
RUNS = 5
PEAKS = 6
LEAST_VOTES = 0.3
GATE = 2.5  # times the jitter: both recorders have it, and the line has a small error


@dataclass(frozen=True)
class Lines:
    """Two lists of edges in seconds, each relative to its own first edge, and their levels (all low if unknown).

    The half widths are those of the edges' errors, None if unknown. `device_kept` and `host_kept` are the indices of
    the edges in the original lists.
    """

    device_s: Float64[np.ndarray, ' n']
    host_s: Float64[np.ndarray, ' m']
    device_level: Bool[np.ndarray, ' n']
    host_level: Bool[np.ndarray, ' m']
    zero_ns: tuple[int, int]
    device_half_s: Float64[np.ndarray, ' n'] | None
    host_half_s: Float64[np.ndarray, ' m'] | None
    device_kept: Int64[np.ndarray, ' n']
    host_kept: Int64[np.ndarray, ' m']

    @classmethod
    def of(
        cls,
        device_ns: Int64[np.ndarray, ' a'],
        host_ns: Int64[np.ndarray, ' b'],
        device_levels: Bool[np.ndarray, ' a'] | None,
        host_levels: Bool[np.ndarray, ' b'] | None,
        device_half_s: Float64[np.ndarray, ' a'] | None,
        host_half_s: Float64[np.ndarray, ' b'] | None,
        bounce_s: float,
    ) -> Lines:
        """From integer nanoseconds, whose precision floating-point seconds cannot hold. Bounces are removed."""
        if device_levels is None or host_levels is None:
            device_levels, host_levels = np.zeros(len(device_ns), bool), np.zeros(len(host_ns), bool)
        device, host = without_bounces(device_ns, bounce_s), without_bounces(host_ns, bounce_s)
        zero = int(device_ns[0]), int(host_ns[0])
        return cls(
            (device_ns[device] - zero[0]) / NS_PER_S,
            (host_ns[host] - zero[1]) / NS_PER_S,
            device_levels[device],
            host_levels[host],
            zero,
            None if device_half_s is None else device_half_s[device],
            None if host_half_s is None else host_half_s[host],
            device,
            host,
        )

    def uncertainty_s(
        self, device: Int64[np.ndarray, ' k'], host: Int64[np.ndarray, ' k']
    ) -> Float64[np.ndarray, ' k'] | None:
        """Half widths of the errors of these pairs, or None if unknown for both lists."""
        if self.device_half_s is None and self.host_half_s is None:
            return None
        squares = [np.zeros(len(device))]
        squares += [self.device_half_s[device] ** 2] if self.device_half_s is not None else []
        squares += [self.host_half_s[host] ** 2] if self.host_half_s is not None else []
        return np.asarray(np.sqrt(np.sum(squares, axis=0)))

    @property
    def middle(self) -> float:
        """Middle of the device's run, in device seconds."""
        return float(self.device_s[-1]) / 2

    @property
    def constant_s(self) -> float:
        """Host zero minus device zero. Add it to offsets of this class to get offsets between the clocks."""
        return (self.zero_ns[1] - self.zero_ns[0]) / NS_PER_S

    def instant_ns(self, device_s: float, host_s: float) -> tuple[int, int]:
        """Convert back to nanoseconds of each clock."""
        return self.zero_ns[0] + round(device_s * NS_PER_S), self.zero_ns[1] + round(host_s * NS_PER_S)


def without_bounces(stamps_ns: Int64[np.ndarray, ' a'], bounce_s: float) -> Int64[np.ndarray, ' k']:
    """Indices of the edges that do not follow another within `bounce_s`. Only the first edge of a bounce is on time.

    For edges at 0, 10, 20 and 200 ms and 50 ms, these are the first and the last.
    """
    apart = np.diff(stamps_ns, prepend=stamps_ns[:1] - 2 * round(bounce_s * NS_PER_S) - 1)
    return np.flatnonzero(apart > bounce_s * NS_PER_S)


@dataclass(frozen=True)
class Match:
    """Pairs of indices, and the line that predicts host time: device_s + level + slope * device_s."""

    device: Int64[np.ndarray, ' k']
    host: Int64[np.ndarray, ' k']
    level: float
    slope: float

    def offset_at(self, device_s: float) -> float:
        """Host time minus device time, by the line."""
        return self.level + self.slope * device_s

    def overlap(self, lines: Lines) -> tuple[int, int]:
        """Number of edges of each list in the time that both cover according to the line."""
        seen = lines.device_s + self.level + self.slope * lines.device_s
        start, end = max(seen[0], lines.host_s[0]), min(seen[-1], lines.host_s[-1])
        slack = 1e-3
        inside = [((s >= start - slack) & (s <= end + slack)).sum() for s in (seen, lines.host_s)]
        return int(inside[0]), int(inside[1])


def best_matches(lines: Lines, jitter_s: float, max_drift: float, max_offset_s: float) -> list[Match]:
    """All candidate matches, the one with the most pairs first."""
    found: list[Match] = []
    for start in _starts(len(lines.device_s)):
        run = np.arange(start, min(start + RUN, len(lines.device_s)))
        for offset in _voted(lines, run, jitter_s, max_drift, max_offset_s):
            if not any(_known(match, lines, run, offset, jitter_s) for match in found):
                found.append(_grown(lines, run, offset, jitter_s, max_drift))
    allowed = [each for each in found if abs(each.offset_at(lines.middle) + lines.constant_s) <= max_offset_s]
    return sorted(allowed, key=lambda match: -len(match.device))


def _starts(count: int) -> list[int]:
    return sorted({round(share * max(0, count - RUN)) for share in np.linspace(0, 1, RUNS)})


def _known(match: Match, lines: Lines, run: Int64[np.ndarray, ' r'], offset: float, jitter_s: float) -> bool:
    middle_s = float(lines.device_s[run].mean())
    return abs(match.offset_at(middle_s) - offset) < GATE * jitter_s


def _voted(
    lines: Lines, run: Int64[np.ndarray, ' r'], jitter_s: float, max_drift: float, max_offset_s: float
) -> list[float]:
    """Offsets on which many pairs of a run's edge and any host edge agree, within jitter and drift."""
    apart = _differences(lines, run)
    slack = max_drift * max(float(lines.device_s[-1]), float(lines.host_s[-1])) + 2 * jitter_s
    apart = np.sort(apart[np.abs(apart + lines.constant_s) <= max_offset_s + slack])
    width = 2 * jitter_s + max_drift * float(np.ptp(lines.device_s[run]))
    votes = np.searchsorted(apart, apart + width, side='right') - np.arange(len(apart))
    peaks: list[float] = []
    while len(peaks) < PEAKS and len(votes) and votes.max() >= max(3, LEAST_VOTES * len(run)):
        first = int(votes.argmax())
        peaks.append(float(np.median(apart[first : first + votes[first]])))
        votes = np.where(np.abs(apart - apart[first]) <= width, 0, votes)
    return peaks


def _differences(lines: Lines, run: Int64[np.ndarray, ' r']) -> Float64[np.ndarray, ' d']:
    found = []
    for level in (False, True):
        device = lines.device_s[run][lines.device_level[run] == level]
        found.append((lines.host_s[lines.host_level == level][None, :] - device[:, None]).ravel())
    return np.concatenate(found)


def _grown(lines: Lines, run: Int64[np.ndarray, ' r'], offset: float, jitter_s: float, max_drift: float) -> Match:
    """The match grown outwards from a run's offset, with increasing steps."""
    low, high = int(run[0]), int(run[-1]) + 1
    gate = GATE * jitter_s + max_drift * float(np.ptp(lines.device_s[run])) / 2
    match = Match(run[:0], run[:0], offset, 0.0)
    while True:
        for _ in range(3):
            match = _rematched(lines, np.arange(low, high), match, gate, max_drift)
            gate = GATE * jitter_s
        if (low, high) == (0, len(lines.device_s)):
            return match
        half = max(4, (high - low) // 2)
        low, high = max(0, low - half), min(len(lines.device_s), high + half)


def _rematched(lines: Lines, part: Int64[np.ndarray, ' p'], match: Match, gate: float, max_drift: float) -> Match:
    device, host = _pairs(lines, part, match, gate)
    if len(device) < 3:
        return Match(device, host, match.level, match.slope)
    x, y = lines.device_s[device], lines.host_s[host] - lines.device_s[device]
    centre = x.mean()
    spread = float(((x - centre) ** 2).sum())
    slope = float((x - centre) @ (y - y.mean())) / spread if spread > 0 else 0.0
    slope = min(max(slope, -max_drift), max_drift)
    level = float(np.median(y - slope * (x - centre)))  # the mean would be biased, as doubled edges are always late
    return Match(device, host, level - slope * float(centre), slope)


def _pairs(
    lines: Lines, part: Int64[np.ndarray, ' p'], match: Match, gate: float
) -> tuple[Int64[np.ndarray, ' k'], Int64[np.ndarray, ' k']]:
    """Edges that are mutual nearest neighbours within the gate."""
    found = [_pairs_of_level(lines, part, match, gate, level) for level in (False, True)]
    device, host = (np.concatenate([pair[side] for pair in found]) for side in (0, 1))
    order = np.argsort(device, kind='stable')
    return device[order], host[order]


def _pairs_of_level(
    lines: Lines, part: Int64[np.ndarray, ' p'], match: Match, gate: float, level: bool
) -> tuple[Int64[np.ndarray, ' k'], Int64[np.ndarray, ' k']]:
    device = part[lines.device_level[part] == level]
    host = np.flatnonzero(lines.host_level == level)
    if len(device) == 0 or len(host) == 0:
        return part[:0], part[:0]
    expected = lines.device_s[device] * (1 + match.slope) + match.level
    there = nearest(lines.host_s[host], expected)
    back = nearest(expected, lines.host_s[host][there])
    mutual = (back == np.arange(len(device))) & (np.abs(lines.host_s[host][there] - expected) <= gate)
    return device[mutual], host[there[mutual]]


def nearest(sorted_s: Float64[np.ndarray, ' a'], wanted_s: Float64[np.ndarray, ' b']) -> Int64[np.ndarray, ' b']:
    """Index of the nearest list entry for each wanted time: 1 for the time 1.4 in (0, 1, 2)."""
    right = np.clip(np.searchsorted(sorted_s, wanted_s), 1, max(1, len(sorted_s) - 1))
    if len(sorted_s) == 1:
        return np.zeros(len(wanted_s), np.int64)
    left_nearer = wanted_s - sorted_s[right - 1] <= sorted_s[right] - wanted_s
    return np.asarray(right - left_nearer, np.int64)
