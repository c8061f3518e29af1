"""Gaps in a stream of forces: images without a force, and forces that did not arrive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tactile_nodes.bus.protocol import Received
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.messages import stamp_ns
from tactile_nodes.viewing.gaps import SequenceGaps


@dataclass
class Gaps:
    """Counts the gaps, for a camera with one frame per `frame_ns`.

    Attributes:
        skipped: images without a force, by the stamps.
        lost: forces that were published but not received, by their sequence numbers.
        longest_ms: the longest time between two successive images with a force.
    """

    skipped: int = 0
    lost: int = 0
    longest_ms: float = 0.0
    frame_ns: float = NS_PER_S / 60

    def __post_init__(self) -> None:
        self._numbers = SequenceGaps()
        self._last_ns: int | None = None

    @property
    def begun(self) -> bool:
        """Whether a force was received."""
        return self._last_ns is not None

    def take(self, received: Received) -> int:
        """Count a received force; returns the stamp of its image."""
        at_ns = stamp_ns(received.message.header.stamp)
        if self._last_ns is not None:
            self.skipped += max(0, round((at_ns - self._last_ns) / self.frame_ns) - 1)
            self.longest_ms = max(self.longest_ms, (at_ns - self._last_ns) / 1e6)
        self.lost += self._numbers.add(received.publisher, received.sequence)
        self._last_ns = at_ns
        return at_ns


@dataclass
class Arrivals(Gaps):
    """Also measures the delay of each force after the capture of its image."""

    late_ms: list[float] = field(default_factory=list)

    def take(self, received: Received) -> int:
        """As `Gaps.take`; also stores the delay."""
        at_ns = super().take(received)
        self.late_ms.append((received.received_ns - at_ns) / 1e6)
        return at_ns


def arrived(streams: Sequence[Arrivals]) -> dict[str, float]:
    """Counts and delays of all streams together; times are NaN if nothing was received."""
    late = [ms for each in streams for ms in each.late_ms] or [math.nan]
    return {
        'forces': sum(len(each.late_ms) for each in streams), 'skipped': sum(each.skipped for each in streams),
        'lost': sum(each.lost for each in streams), 'p50_ms': float(np.percentile(late, 50)),
        'p99_ms': float(np.percentile(late, 99)), 'worst_ms': max(late),
        'longest_ms': max(each.longest_ms for each in streams),
    }  # fmt: skip
