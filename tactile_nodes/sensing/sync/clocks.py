"""Offset and drift between two recorders, from the edges of one digital line that both recorded.

``t_host = a + b * t_device``. Recorders start at different times, miss edges, see some twice (a bouncing contact), and
have jitter. So edges must be matched before a line can be fitted (`sync.matching`). An ambiguous match is refused with
the reason, because a wrong match is off by a whole press and still fits perfectly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from tactile_nodes.sensing.sync.matching import Lines, Match, best_matches
from tactile_nodes.sensing.sync.robust import RobustLine, bend, robust_line
from tactile_nodes.shapes import Bool, Float64, Int64

NS_PER_S = 1_000_000_000
ENOUGH_MATCHED = 0.6
ENOUGH_INLIERS = 0.75
RIVAL_SHARE = 0.75
MISSED, IN_A_ROW = 7, 10
FINEST_S = 20e-6


@dataclass(frozen=True)
class SyncLimits:
    """Prior knowledge about the clocks, and requirements on the result.

    Attributes:
        jitter_s: largest error of an edge in either recorder: half a frame for a camera.
        max_drift_ppm: largest difference of the clocks' rates.
        max_offset_s: largest difference of the clocks; infinite: unknown. With a periodic line, less than half its
            period makes the match unique.
        required_s: largest error allowed between the device's first and last edge, at four standard deviations.
        fewest: least number of matched edges.
        bounce_s: of edges that follow each other within this time only the first counts; 0: all count.
    """

    jitter_s: float = 0.02
    max_drift_ppm: float = 200.0
    max_offset_s: float = math.inf
    required_s: float = 0.002
    fewest: int = 8
    bounce_s: float = 0.05


@dataclass(frozen=True)
class ClockFit:
    """The host's time as a function of the device's.

    Attributes:
        device_ref_ns, host_ref_ns: the same instant on both clocks, in the middle of the matched edges.
        rate: seconds of the host per second of the device.
        device_index, host_index: indices of the matched edges in the two lists, without outliers.
        edges: number of device and of host edges in the time that both recorded.
        residual_median_s, residual_max_s: absolute residuals of the inliers.
        bound_s: largest error between the device's first and last edge, at four standard deviations.
    """

    device_ref_ns: int
    host_ref_ns: int
    rate: float
    device_index: Int64[np.ndarray, ' k']
    host_index: Int64[np.ndarray, ' k']
    edges: tuple[int, int]
    residual_median_s: float
    residual_max_s: float
    bound_s: float

    @property
    def inliers(self) -> int:
        """Number of edges that the line was fitted to."""
        return len(self.device_index)

    @property
    def drift_ppm(self) -> float:
        """By how much the host's clock runs faster than the device's."""
        return (self.rate - 1.0) * 1e6

    @property
    def offset_s(self) -> float:
        """Host time minus device time at the reference instant."""
        return (self.host_ref_ns - self.device_ref_ns) / NS_PER_S

    def host_ns(self, device_ns: Int64[np.ndarray, '*shape']) -> Int64[np.ndarray, '*shape']:
        """Convert device times to host times.

        With a rate of 1.0001, a device time 10 s after the reference is a host time 10.001 s after it.
        """
        since = device_ns - self.device_ref_ns
        gained = np.rint(since * (self.rate - 1.0)).astype(np.int64)  # only the small part, to lose no digit
        return np.asarray(self.host_ref_ns + since + gained)


class Reason(Enum):
    """Why there is no fit."""

    TOO_FEW_EDGES = 'too few edges'
    AMBIGUOUS = 'several matches are equally good'
    NO_MATCH = 'no consistent match'
    RESIDUALS = 'residuals too large'


@dataclass(frozen=True)
class Refusal:
    """The reason why there is no fit, and a sentence with advice."""

    reason: Reason
    text: str


def fit_clocks(
    device_ns: Int64[np.ndarray, ' n'],
    host_ns: Int64[np.ndarray, ' m'],
    limits: SyncLimits = SyncLimits(),
    device_levels: Bool[np.ndarray, ' n'] | None = None,
    host_levels: Bool[np.ndarray, ' m'] | None = None,
    device_uncertainty_s: Float64[np.ndarray, ' n'] | None = None,
    host_uncertainty_s: Float64[np.ndarray, ' m'] | None = None,
) -> ClockFit | Refusal:
    """Fit the clock relation to two lists of the same edges.

    Args:
        device_ns: edges on the device's clock, in its nominal nanoseconds, not decreasing.
        host_ns: edges on the host's clock, not decreasing.
        limits: prior knowledge and requirements.
        device_levels, host_levels: the line's level after each edge; if both are given, a rise matches only a rise.
        device_uncertainty_s, host_uncertainty_s: half width of each edge's error, if the recorder knows it; more
            precise edges then have more weight.
    """
    fewest = max(3, limits.fewest)
    if min(len(device_ns), len(host_ns)) < fewest:
        return _too_few(min(len(device_ns), len(host_ns)), fewest)
    lines = Lines.of(
        device_ns, host_ns, device_levels, host_levels, device_uncertainty_s, host_uncertainty_s, limits.bounce_s
    )
    matches = best_matches(lines, limits.jitter_s, limits.max_drift_ppm * 1e-6, limits.max_offset_s)
    if not matches:
        return _no_match(0, len(lines.device_s), len(lines.host_s))
    return _judged(lines, matches, limits, fewest)


def _judged(lines: Lines, matches: list[Match], limits: SyncLimits, fewest: int) -> ClockFit | Refusal:
    best = matches[0]
    edges = best.overlap(lines)
    if len(best.device) < max(3, ENOUGH_MATCHED * min(edges)):
        return _no_match(len(best.device), *edges)
    for rival in matches[1:]:
        apart_s = abs(rival.offset_at(lines.middle) - best.offset_at(lines.middle))
        harmless = apart_s <= 2 * limits.jitter_s or len(rival.device) < RIVAL_SHARE * len(best.device)
        if not harmless and not _outdone(lines, best, rival):
            return _ambiguous(best, rival, apart_s)
    if len(best.device) < fewest:
        return _too_few(len(best.device), fewest)
    return _laid(lines, best, limits, edges)


def _outdone(lines: Lines, best: Match, rival: Match) -> bool:
    """Whether the rival leaves a stretch unmatched that the best match explains, and never the reverse.

    Between equal presses the irregular edges are few. A match shifted by one press misses nearly all of them in a row,
    while edges that a recorder missed by chance are scattered.
    """
    return _most_missed(lines, best, rival) >= MISSED > 3 * _most_missed(lines, rival, best)


def _most_missed(lines: Lines, known: Match, other: Match) -> int:
    """Among any ten consecutive edges matched in `known`, the largest number that is unmatched in `other`.

    Only edges in the time that both recorded, according to `other`, count. With 5 % missing edges, seven of ten are
    missing by chance with a probability of 9e-8.
    """
    seen_s = lines.device_s[known.device] * (1 + other.slope) + other.level
    inside = (seen_s >= lines.host_s[0]) & (seen_s <= lines.host_s[-1])
    missed = ~np.isin(known.device[inside], other.device)
    return int(np.convolve(missed, np.ones(IN_A_ROW, np.int64)).max()) if len(missed) else 0


def _laid(lines: Lines, match: Match, limits: SyncLimits, edges: tuple[int, int]) -> ClockFit | Refusal:
    x, y = lines.device_s[match.device], lines.host_s[match.host] - lines.device_s[match.device]
    line = robust_line(x, y, lines.uncertainty_s(match.device, match.host), FINEST_S)
    if abs(line.slope) > limits.max_drift_ppm * 1e-6:
        return Refusal(
            Reason.NO_MATCH,
            f'the best match of the edges gives a clock drift of {line.slope * 1e6:+.0f} ppm, but at most '
            f'{limits.max_drift_ppm:g} ppm are allowed; check that both lists are of the same run',
        )
    bound_s = line.bound(x, y, lines.device_s[[0, -1]], FINEST_S)
    if (trouble := _trouble(line, x, line.residual(x, y), bound_s, limits.required_s)) is not None:
        return trouble
    size = np.abs(line.residual(x, y)[line.inlier])
    device_ref_ns, host_ref_ns = lines.instant_ns(line.centre, line.centre + line.level)
    return ClockFit(
        device_ref_ns,
        host_ref_ns,
        1.0 + line.slope,
        lines.device_kept[match.device[line.inlier]],
        lines.host_kept[match.host[line.inlier]],
        edges,
        float(np.median(size)),
        float(size.max()),
        bound_s,
    )


def _trouble(
    line: RobustLine,
    x: Float64[np.ndarray, ' n'],
    residual: Float64[np.ndarray, ' n'],
    bound_s: float,
    required_s: float,
) -> Refusal | None:
    if (share := float(line.inlier.mean())) < ENOUGH_INLIERS:
        return Refusal(
            Reason.RESIDUALS,
            f'only {share:.0%} of the matched edges lie on one line; check for a recorder with irregular stamps',
        )
    if bound_s > required_s:
        return Refusal(
            Reason.RESIDUALS,
            f'{int(line.inlier.sum())} edges give the time only to {bound_s * 1e3:.2f} ms, but {required_s * 1e3:g} ms '
            'are required; record more edges over the whole run, or with less jitter',
        )
    bend_s = bend(x[line.inlier], residual[line.inlier])
    if bend_s > required_s:
        return Refusal(
            Reason.RESIDUALS,
            f'one of the clocks changed its rate: parts of the run are {bend_s * 1e3:.2f} ms off the line; '
            'synchronise shorter parts',
        )
    return None


def _too_few(count: int, fewest: int) -> Refusal:
    return Refusal(
        Reason.TOO_FEW_EDGES,
        f'too few edges seen by both to synchronise: {count}, and {fewest} are needed; switch the line more often',
    )


def _no_match(matched: int, device: int, host: int) -> Refusal:
    return Refusal(
        Reason.NO_MATCH,
        f'only {matched} of {device} and {host} edges match; check that both recorders saw the same line in '
        'the same run, and that the limits of offset, drift and jitter are right',
    )


def _ambiguous(best: Match, rival: Match, apart_s: float) -> Refusal:
    return Refusal(
        Reason.AMBIGUOUS,
        f'the edges match in several ways ({len(best.device)} of them, or {len(rival.device)} shifted by '
        f'{apart_s:.3f} s); switch the line at irregular times, or limit the offset',
    )
