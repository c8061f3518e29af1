"""What bridges tell each other of their machines, under which keys, and what they learn of each other's clocks."""

from __future__ import annotations

import json
import struct
from collections import deque
from dataclasses import asdict, dataclass

from tactile_nodes.bus.protocol import Participant
from tactile_nodes.bus.zeromq.records import Outlet, checked, participant_from
from tactile_nodes.errors import MessageError
from tactile_nodes.params import matches

VERSION = '5'
MALFORMED = (MessageError, ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError, struct.error)
EVERYBODY = '*'
_ROOT = 'tactile_nodes'
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


def key_of(uid: str, *parts: str, version: str = VERSION) -> str:
    """The Zenoh key expression of what the bridge of a participant offers.

    >>> key_of('1f', 'state')
    'tactile_nodes/5/1f/state'
    """
    return '/'.join((_ROOT, version, uid, *parts))


def bridge_of(key: str) -> tuple[str, str]:
    """The version and the uid of the bridge whose key expression this is."""
    _, version, uid, *_ = key.split('/')
    return version, uid


@dataclass(frozen=True)
class State:
    """One machine as its bridge sees it: who lives there, and what may be had of them. Each change has a number."""

    number: int
    host: str
    participants: tuple[Participant, ...]
    outlets: tuple[Outlet, ...]

    def to_json(self) -> bytes:
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_json(cls, text: bytes) -> State:
        """The reverse. Raises one of `MALFORMED`."""
        fields = json.loads(text)
        return cls(
            int(fields['number']),
            str(fields['host']),
            tuple(map(participant_from, fields['participants'])),
            tuple(checked(Outlet, entry) for entry in fields['outlets']),
        )


class ClockOffset:
    """How far another machine's clock is ahead of ours, by the quickest of the last exchanges.

    >>> clock = ClockOffset()
    >>> clock.hear(asked_ns=100, theirs_ns=1_000_500, now_ns=900)  # 800 there and back: at our 500 it was 1000500 there
    >>> clock.ahead_ns
    1000000
    """

    def __init__(self) -> None:
        self._exchanges: deque[tuple[int, int]] = deque(maxlen=_KEPT)

    def hear(self, asked_ns: int, theirs_ns: int, now_ns: int) -> None:
        """Take in what the other's clock said between our asking and now."""
        self._exchanges.append((now_ns - asked_ns, theirs_ns - (asked_ns + now_ns) // 2))

    @property
    def ahead_ns(self) -> int | None:
        """The other's clock less ours; None before the first exchange."""
        return min(self._exchanges)[1] if self._exchanges else None
