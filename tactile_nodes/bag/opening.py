"""The start of a recording: all topics start at the same moment, although they connect one after another."""

from __future__ import annotations

import fnmatch
import math
from typing import Any, NamedTuple

from tactile_nodes.clock import NS_PER_S

PATIENCE_S = 2.0
"""How long a topic may take until its first message arrives; on a loaded machine 1.3 s were measured."""

_SOON = 100  # messages: a publisher that has sent more was running before, as a camera beside a replay


class Arrival(NamedTuple):
    """A received message. `content` is passed on unchanged; `received_ns` and `source_ns` as in a bag."""

    topic: str
    publisher: str
    sequence: int
    source_ns: int
    received_ns: int
    content: Any


class Opening:
    """Holds messages until one has come on every awaited topic, or for `PATIENCE_S`.

    With `begins_with`, a full name or a shell pattern, it always waits for a message on that topic. It never holds more
    than `most_bytes`.

    The bag begins when every topic that was already running has delivered a message. Earlier messages of awaited topics
    are dropped, because other topics have no counterpart. Earlier messages of other topics are dropped too, unless they
    were received from their publisher's first message on, such as the first press of a plan. Latched messages are kept.
    """

    def __init__(self, now_ns: int, begins_with: str = '', most_bytes: float = math.inf) -> None:
        self._begins_with = begins_with
        self._most_bytes, self._bytes = most_bytes, 0
        self._awaited: set[str] = set()
        self._latched: set[str] = set()
        self._begun_ns = now_ns
        self._held: list[Arrival] = []
        self._first: dict[tuple[str, str], Arrival] = {}

    def expect(self, topic: str, *, latched: bool, awaited: bool) -> None:
        """Announce a topic; `latched` ones send their last message to new subscribers."""
        if latched:
            self._latched.add(topic)
        if awaited:
            self._awaited.add(topic)

    def hold(self, arrival: Arrival, size: int = 0) -> None:
        """Hold a message of this size [bytes]."""
        self._held.append(arrival)
        self._bytes += size
        self._first.setdefault((arrival.topic, arrival.publisher), arrival)

    @property
    def silent(self) -> list[str]:
        """The awaited topics without a message so far."""
        return sorted(self._awaited - {topic for topic, _ in self._first})

    @property
    def has_begun(self) -> bool:
        """Whether a message has come on the topic with which the recording starts, of one who starts to publish."""
        early = [each.topic for each in self._first.values() if each.sequence <= _SOON]
        return not self._begins_with or bool(fnmatch.filter(early, self._begins_with))

    @property
    def is_full(self) -> bool:
        """Whether no more messages can be held."""
        return self._bytes > self._most_bytes

    def is_over(self, now_ns: int) -> bool:
        """Whether to stop waiting."""
        waited = not self.silent or now_ns - self._begun_ns >= PATIENCE_S * NS_PER_S
        return self.is_full or (self.has_begun and waited)

    @property
    def begin_ns(self) -> int:
        """The time when every awaited topic that was already running had delivered a message."""
        joined = [each for each in self._first.values() if each.sequence > 1 and each.topic not in self._latched]
        return max((each.received_ns for each in joined if each.topic in self._awaited), default=self._begun_ns)

    def release(self) -> list[tuple[Arrival, int]]:
        """The first messages to write, with receive times; latched messages first."""
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
