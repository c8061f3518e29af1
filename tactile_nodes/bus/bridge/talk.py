"""What bridges tell each other of their machines, and what they learn of each other's clocks."""

from __future__ import annotations

import json
import struct
from collections import deque
from dataclasses import asdict, dataclass

from tactile_nodes.bus.protocol import Participant
from tactile_nodes.bus.zeromq.records import Outlet, checked, participant_from
from tactile_nodes.errors import MessageError
from tactile_nodes.params import matches

FORMAT = 2
MALFORMED = (MessageError, ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError, struct.error)
_KEPT = 20


@dataclass(frozen=True)
class Choice:
    """Patterns (``*`` one level, ``**`` any depth) of the topics given and taken, and of the services to be called."""

    send: tuple[str, ...] = ('/**',)
    receive: tuple[str, ...] = ('/**',)
    serve: tuple[str, ...] = ('/**',)


def fits(name: str, patterns: tuple[str, ...]) -> bool:
    """Whether one of the patterns covers a name."""
    return any(matches(pattern, name) for pattern in patterns)


@dataclass(frozen=True)
class State:
    """One machine as its bridge sees it: who lives there, what may be had of them, and whom it is ready to repeat
    (``<gid>/<number of the relay>``)."""

    uid: str
    host: str
    participants: tuple[Participant, ...]
    outlets: tuple[Outlet, ...]
    wants: tuple[str, ...] = ()

    def to_json(self, stamps: list[int]) -> bytes:
        """With the stamps of `ClockOffset.ask`."""
        return json.dumps({'format': FORMAT, 'stamps': stamps, **asdict(self)}).encode()

    @classmethod
    def from_json(cls, text: str) -> tuple[State, list[int]]:
        """The reverse. Raises one of `MALFORMED`."""
        fields = json.loads(text)
        if fields['format'] != FORMAT:
            raise MessageError('a bridge of another version')
        stamps = [int(stamp) for stamp in fields['stamps']]
        if len(stamps) != 3:
            raise MessageError('a bridge that sends no time')
        return cls(
            str(fields['uid']),
            str(fields['host']),
            tuple(map(participant_from, fields['participants'])),
            tuple(checked(Outlet, entry) for entry in fields['outlets']),
            tuple(map(str, fields['wants'])),
        ), stamps


class ClockOffset:
    """How far another machine's clock is ahead of ours, by the quickest of the last exchanges (as NTP does it).

    >>> clock = ClockOffset()
    >>> clock.hear([1_000_500, 100, 300], 600)  # our 100 was answered after 300, and came back at 600: 200 under way
    >>> clock.ahead_ns  # at our 500 it was 1000500 there
    1000000
    """

    def __init__(self) -> None:
        self._theirs_ns = self._heard_ns = 0
        self._exchanges: deque[tuple[int, int]] = deque(maxlen=_KEPT)

    def ask(self, now_ns: int) -> list[int]:
        """What to send: our time, their last one, and how long we have kept it."""
        return [now_ns, self._theirs_ns, now_ns - self._heard_ns if self._theirs_ns else 0]

    def hear(self, stamps: list[int], now_ns: int) -> None:
        """Take in what the other sent."""
        self._theirs_ns, ours_ns, kept_ns = stamps
        self._heard_ns = now_ns
        if ours_ns:
            round_trip_ns = now_ns - ours_ns - kept_ns
            self._exchanges.append((round_trip_ns, self._theirs_ns - (now_ns - round_trip_ns // 2)))

    @property
    def ahead_ns(self) -> int | None:
        """The other's clock less ours; None before the first exchange."""
        return min(self._exchanges)[1] if self._exchanges else None
