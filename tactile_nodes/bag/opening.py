"""How a recording begins: with all topics at the same moment, though they are connected one after the other."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Any, NamedTuple

from tactile_nodes.clock import NS_PER_S

PATIENCE_S = 2.0
"""So long a topic that is there may take until something of it comes in; on a loaded machine 1.3 s were seen."""


class Arrival(NamedTuple):
    """A message that came in. `content` is handed on as it is; `received_ns` and `source_ns` as in a bag."""

    topic: str
    publisher: str
    sequence: int
    source_ns: int
    received_ns: int
    content: Any


class Opening:
    """Holds what comes in until something has come of every awaited topic, or for `PATIENCE_S`.

    With `begins_with`, a full name or a pattern of shells, in any case until something has come of that topic.

    The bag begins when the last of those that had begun before was heard. What came earlier of awaited topics goes,
    because other topics have no counterpart to it, and what came of others, unless it was heard from its publisher's
    first message on, as the first press of a plan. What latched topics said stays.
    """

    def __init__(self, now_ns: int, begins_with: str = '') -> None:
        self._begins_with = begins_with
        self._awaited: set[str] = set()
        self._latched: set[str] = set()
        self._begun_ns = now_ns
        self._held: list[Arrival] = []
        self._first: dict[tuple[str, str], Arrival] = {}

    def expect(self, topic: str, *, latched: bool, awaited: bool) -> None:
        """A topic that is there; `latched` ones give their last message to whoever comes."""
        if latched:
            self._latched.add(topic)
        if awaited:
            self._awaited.add(topic)

    def hold(self, arrival: Arrival) -> None:
        """Take in a message."""
        self._held.append(arrival)
        self._first.setdefault((arrival.topic, arrival.publisher), arrival)

    @property
    def silent(self) -> list[str]:
        """The awaited topics of which nothing has come yet."""
        return sorted(self._awaited - {topic for topic, _ in self._first})

    @property
    def has_begun(self) -> bool:
        """Whether something has come of the topic without which nothing begins."""
        return not self._begins_with or any(fnmatchcase(topic, self._begins_with) for topic, _ in self._first)

    def is_over(self, now_ns: int) -> bool:
        """Whether to wait no longer."""
        return self.has_begun and (not self.silent or now_ns - self._begun_ns >= PATIENCE_S * NS_PER_S)

    @property
    def begin_ns(self) -> int:
        """When all that was joined in the middle was there."""
        joined = [each for each in self._first.values() if each.sequence > 1 and each.topic not in self._latched]
        return max((each.received_ns for each in joined if each.topic in self._awaited), default=self._begun_ns)

    def release(self) -> list[tuple[Arrival, int]]:
        """What to write first, with times of receipt; latched messages first."""
        kept = [each for each in self._held if each.topic not in self._latched and self._stays(each)]
        start_ns = min((each.received_ns for each in kept), default=self.begin_ns)
        latched = [
            (each, start_ns if each.source_ns < start_ns else each.received_ns)
            for each in self._held
            if each.topic in self._latched
        ]
        return [*latched, *((each, each.received_ns) for each in kept)]

    def _stays(self, arrival: Arrival) -> bool:
        is_whole = self._first[arrival.topic, arrival.publisher].sequence == 1
        return arrival.received_ns >= self.begin_ns or (is_whole and arrival.topic not in self._awaited)
