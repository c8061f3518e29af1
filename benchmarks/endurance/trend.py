"""The growth of a process: looks at it over time, and the line through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

MB = 2**20
PARTS = 10
SETTLED = 0.2
"""Share of the time after which a process has loaded everything and filled its buffers."""


@dataclass(frozen=True)
class Look:
    """One look at a process: time [s], resident memory [MiB], open files, threads and CPU time [s]."""

    at_s: float
    memory_mb: float
    files: int
    threads: int
    cpu_s: float


def growth(looks: Sequence[Look]) -> dict[str, Any]:
    """The first and last values of a process after it has settled, the maximum of all, and the slope.

    `mb_per_hour` is the slope of the line through the memory of all looks after the first fifth (least squares). It is
    NaN for fewer than three looks; 100 MiB at 0 s and 101 MiB at 1800 s make 2. `steady_mb_per_hour` is the median of
    the slopes in ten parts of that time. A leak with each frame grows in every part, but a heap that is enlarged once,
    in a moment of much work, grows in only one.
    """
    settled = looks[round(SETTLED * len(looks)) :]
    first, last = settled[0], settled[-1]
    return {
        'memory_mb': {'first': first.memory_mb, 'last': last.memory_mb, 'most': max(look.memory_mb for look in looks)},
        'mb_per_hour': slope_per_hour([look.at_s for look in settled], [look.memory_mb for look in settled]),
        'steady_mb_per_hour': steady_per_hour(settled),
        'files': {'first': first.files, 'last': last.files, 'most': max(look.files for look in looks)},
        'threads': {'first': first.threads, 'last': last.threads, 'most': max(look.threads for look in looks)},
        'cpu_share': (last.cpu_s - first.cpu_s) / (last.at_s - first.at_s) if last.at_s > first.at_s else float('nan'),
    }


def steady_per_hour(looks: Sequence[Look]) -> float:
    """The median of the slopes of memory in ten parts; the slope of the whole if the parts would be too short."""
    size = max(3, len(looks) // PARTS) if len(looks) >= 3 * PARTS else len(looks)
    parts = (looks[first : first + size] for first in range(0, len(looks) - size + 1, size))
    return float(np.median([slope_per_hour([at.at_s for at in part], [at.memory_mb for at in part]) for part in parts]))


def slope_per_hour(at_s: Sequence[float], values: Sequence[float]) -> float:
    """The rise of the line through the values, per hour."""
    if len(at_s) < 3:
        return float('nan')
    return float(np.polyfit(np.asarray(at_s) / 3600, values, 1)[0])
