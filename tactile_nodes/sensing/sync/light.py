"""Edges of a light in the camera's view, resolved within a frame: the frame of the edge is only partly bright."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Bool, Float64, Int64

NS_PER_S = 1_000_000_000
HISTORY, KEPT, AFTER = 600, 8, 3
SETTLED = 0.15  # a frame this close to dark or bright counts as such: noise, and the ends of the response curve
LINEARITY = 0.15  # largest error of a linear response model, as a share of the exposure


@dataclass(frozen=True)
class LightEdges:
    """When a light changed, its level from then on, and the half width of the interval of its possible times."""

    stamp_ns: Int64[np.ndarray, ' k']
    level: Bool[np.ndarray, ' k']
    uncertainty_s: Float64[np.ndarray, ' k']


class LightWatch:
    """Finds the edges of a light as frames arrive. Each edge is reported once, three frames later.

    If an exposure of 10 ms that begins at 100 ms has 0.3 of the brightness, the light was on for its last 3 ms: it
    went on at 107 ms. If no frame is partly bright, the edge is placed in the middle between two exposures. A flash
    within one frame gives no edge, and one shorter than four frames may be timed less accurately. Dark and bright
    levels come from the last 600 frames, so the first edge is reported in the fourth bright frame.

    Args:
        exposure_s: 0 if unknown; an edge is then only known to lie between two frames.
        contrast: least difference of dark and bright in grey levels; with less there are no edges.
    """

    def __init__(self, exposure_s: float, contrast: float = 20.0) -> None:
        self._exposure_s = exposure_s
        self._contrast = contrast
        self._history: deque[float] = deque(maxlen=HISTORY)
        self._start_ns: list[int] = []
        self._brightness: list[float] = []

    def take(self, start_ns: int, brightness: float) -> LightEdges:
        """Take one frame, not earlier than the last: the start of its exposure, and the mean grey level of a region
        with the light and little else. Returns the edges that are now certain, mostly none."""
        self._history.append(brightness)
        self._start_ns.append(start_ns)
        self._brightness.append(brightness)
        levels = _levels(np.array(self._history), self._contrast)
        share = _share(np.array(self._brightness), levels)
        found = _edges(np.array(self._start_ns, np.int64), share, self._exposure_s)
        if len(found.stamp_ns) == 0:
            self._forget(len(self._start_ns) - KEPT)
            return found
        changed = _first_change(share)
        if len(self._start_ns) - changed <= AFTER:
            return LightEdges(found.stamp_ns[:0], found.level[:0], found.uncertainty_s[:0])
        self._forget(changed)
        return LightEdges(found.stamp_ns[:1], found.level[:1], found.uncertainty_s[:1])

    def _forget(self, count: int) -> None:
        if count > 0:
            del self._start_ns[:count], self._brightness[:count]


def _first_change(share: Float64[np.ndarray, ' n']) -> int:
    """Index of the first settled frame after the first edge."""
    settled = _settled(share)
    lit = share[settled] > 0.5
    return int(settled[1:][lit[1:] != lit[:-1]][0])


def _settled(share: Float64[np.ndarray, ' n']) -> Int64[np.ndarray, ' k']:
    return np.flatnonzero((share <= SETTLED) | (share >= 1 - SETTLED))


def _edges(start_ns: Int64[np.ndarray, ' n'], share: Float64[np.ndarray, ' n'], exposure_s: float) -> LightEdges:
    settled = _settled(share)
    lit = share[settled] > 0.5
    found = [
        _edge(start_ns, share, int(settled[k]), int(settled[k + 1]), bool(lit[k + 1]), exposure_s)
        for k in np.flatnonzero(lit[1:] != lit[:-1])
    ]
    return LightEdges(
        np.array([stamp for stamp, _, _ in found], np.int64),
        np.array([level for _, level, _ in found], bool),
        np.array([half for _, _, half in found], np.float64),
    )


def _levels(brightness: Float64[np.ndarray, ' n'], contrast: float) -> tuple[float, float] | None:
    """Dark and bright level, or None without enough contrast."""
    if len(brightness) == 0 or float(np.ptp(brightness)) < contrast:
        return None
    middle = (float(brightness.min()) + float(brightness.max())) / 2
    dark = float(np.median(brightness[brightness < middle]))
    bright = float(np.median(brightness[brightness >= middle]))
    return (dark, bright) if bright - dark >= contrast else None


def _share(brightness: Float64[np.ndarray, ' n'], levels: tuple[float, float] | None) -> Float64[np.ndarray, ' n']:
    """From 0 (dark) to 1 (bright); all dark if there are no two levels."""
    if levels is None:
        return np.zeros_like(brightness)
    dark, bright = levels
    return np.clip((brightness - dark) / (bright - dark), 0.0, 1.0)


def _edge(
    start_ns: Int64[np.ndarray, ' n'],
    share: Float64[np.ndarray, ' n'],
    before: int,
    after: int,
    level: bool,
    exposure_s: float,
) -> tuple[int, bool, float]:
    """The edge between two settled frames of different brightness."""
    exposure_ns = exposure_s * NS_PER_S
    if after - before == 2 and exposure_s > 0:
        lit = float(share[before + 1])
        since = 1 - lit if level else lit
        return int(start_ns[before + 1]) + round(since * exposure_ns), level, LINEARITY * exposure_s
    earliest = int(start_ns[before]) + round((1 - SETTLED) * exposure_ns)
    latest = int(start_ns[after]) + round(SETTLED * exposure_ns)
    earliest, latest = min(earliest, latest), max(earliest, latest)
    return (earliest + latest) // 2, level, (latest - earliest) / 2 / NS_PER_S
