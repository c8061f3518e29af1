"""Which messages of a publisher did not come."""

from __future__ import annotations


class SequenceGaps:
    """Messages that publishers sent and that never came, from their running numbers."""

    def __init__(self) -> None:
        self.total = 0
        self._newest: dict[str, int] = {}

    def add(self, publisher: str, sequence: int) -> int:
        """How many are missing just before this one."""
        missing = max(0, sequence - self._newest.get(publisher, sequence - 1) - 1)
        self._newest[publisher] = sequence
        self.total += missing
        return missing
