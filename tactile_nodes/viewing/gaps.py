"""Lost messages of a publisher."""

from __future__ import annotations


class SequenceGaps:
    """Messages that were published but never received, from sequence numbers."""

    def __init__(self) -> None:
        self.total = 0
        self._newest: dict[str, int] = {}

    def add(self, publisher: str, sequence: int) -> int:
        """How many are missing just before this one."""
        missing = max(0, sequence - self._newest.get(publisher, sequence - 1) - 1)
        self._newest[publisher] = sequence
        self.total += missing
        return missing
