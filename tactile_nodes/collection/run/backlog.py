"""What waits for a listener: the newest pieces, and how many bytes of older ones gave way to them."""

from __future__ import annotations

import threading
from collections import deque

Piece = tuple[str, int, bytes]
"""Bytes as they passed, see `drivers.cnc.contract.Traffic`."""


class Backlog:
    """Any thread may put and take; nobody waits for more than that.

    Args:
        most: pieces that are kept.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._lock = threading.Lock()
        self._pieces: deque[Piece] = deque()
        self._dropped = 0

    def put(self, piece: Piece) -> None:
        """Keep a piece; where there are too many, the oldest goes."""
        with self._lock:
            self._pieces.append(piece)
            if len(self._pieces) > self._most:
                self._dropped += len(self._pieces.popleft()[2])

    def take(self) -> Piece | None:
        """The oldest; None: nothing waits."""
        with self._lock:
            return self._pieces.popleft() if self._pieces else None

    def take_dropped(self) -> int:
        """How many bytes were dropped since this was asked last."""
        with self._lock:
            dropped, self._dropped = self._dropped, 0
            return dropped
