"""What is missing in a stream of forces: images that none answers, and forces that did not arrive."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.bus.protocol import Received
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.messages import stamp_ns
from tactile_nodes.viewing.gaps import SequenceGaps


@dataclass
class Gaps:
    """Counts them, of a camera whose frames are `frame_ns` apart.

    Attributes:
        skipped: images of the camera that no force answers, by the stamps.
        lost: forces that were published and did not come, by their numbers.
        longest_ms: the longest time between two images that were answered.
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
        """Whether a force came yet."""
        return self._last_ns is not None

    def take(self, received: Received) -> int:
        """A force came; the stamp of its image."""
        at_ns = stamp_ns(received.message.header.stamp)
        if self._last_ns is not None:
            self.skipped += max(0, round((at_ns - self._last_ns) / self.frame_ns) - 1)
            self.longest_ms = max(self.longest_ms, (at_ns - self._last_ns) / 1e6)
        self.lost += self._numbers.add(received.publisher, received.sequence)
        self._last_ns = at_ns
        return at_ns
