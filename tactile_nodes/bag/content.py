"""What a reader gets from a storage file, and what it asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

ALWAYS_NS = (-(2**63), 2**63)


@dataclass(frozen=True)
class BagMessage:
    """One message of a bag: `log_ns` is when it was received, `publish_ns` its capture stamp or when it was sent."""

    topic: str
    type_name: str
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass(frozen=True)
class Selection:
    """Which messages to read: topics (None: all) and a half-open interval of receive times."""

    topics: frozenset[str] | None = None
    start_ns: int = ALWAYS_NS[0]
    end_ns: int = ALWAYS_NS[1]

    def has(self, topic: str) -> bool:
        return self.topics is None or topic in self.topics

    def wants(self, topic: str, log_ns: int) -> bool:
        return self.start_ns <= log_ns < self.end_ns and self.has(topic)


Complain = Callable[[str], None]
"""Receives a sentence about a part of a file that could not be read."""
