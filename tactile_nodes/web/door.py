"""Who may connect to a server at all, judged when a connection comes in, before a byte of it is read."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from typing import Any, cast
from weakref import WeakKeyDictionary, WeakSet

from tactile_nodes.web import accounts

MOST_CONNECTIONS = 128  # of owners, and of guests
MOST_TURNED_AWAY = 32  # at once; the others are cut off without a word
TURNED_AWAY_WITHIN_S = 5.0
_REFUSAL = (
    'HTTP/1.1 403 Forbidden\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {length}\r\n'
    'Connection: close\r\nX-Content-Type-Options: nosniff\r\n\r\n'
)
_TEXT = (
    'This is served to the account that started it (uid {owner}), and this request comes from {who}. '
    'Open it from that account on that machine; from another machine go through ssh. '
    'How to let others in stands in the documentation under "guests".\n'
)


class Door:
    """Lets the programs of the `owners` in, and, where there are to be `guests`, everybody; knows who is which.

    Guests may take all places of theirs, and none of an owner's. `refused` counts who was not let in.
    """

    def __init__(self, *, guests: bool, owners: frozenset[int] | None = None) -> None:
        self.refused = 0
        self._owners = accounts.owners() if owners is None else owners
        self._guests = guests
        self._inside: WeakKeyDictionary[asyncio.BaseTransport, bool] = WeakKeyDictionary()
        self._turned_away: WeakSet[_TurnedAway] = WeakSet()

    def is_owner(self, transport: asyncio.BaseTransport | None) -> bool:
        """Whether a connection that was let in is an owner's."""
        return transport is not None and self._inside.get(transport, False)

    def opening_to(self, serve: Callable[[], Any]) -> Callable[[], asyncio.Protocol]:
        """The factory of protocols for asyncio; `serve` makes the one that answers those who are let in."""
        return lambda: _Arriving(lambda transport: self._admit(transport, serve))

    def close(self) -> None:
        """Cut off all who are still connected, whatever they have not read yet."""
        connected = *self._inside, *(each.transport for each in self._turned_away)
        for transport in connected:
            if isinstance(transport, asyncio.Transport) and not _is_gone(transport):
                transport.abort()

    def _admit(self, transport: asyncio.Transport, serve: Callable[[], Any]) -> None:
        peer, here = (transport.get_extra_info(name)[:2] for name in ('peername', 'sockname'))
        account = accounts.account_of(peer, here)
        owned = account in self._owners
        alike = sum(kind == owned and not each.is_closing() for each, kind in self._inside.items())
        if not (owned or self._guests):
            self._turn_away(transport, account)
        elif alike >= MOST_CONNECTIONS:
            self.refused += 1
            transport.abort()
        else:
            self._inside[transport] = owned
            _hand_over(transport, serve())

    def _turn_away(self, transport: asyncio.Transport, account: int | None) -> None:
        self.refused += 1
        if len(self._turned_away) >= MOST_TURNED_AWAY:
            transport.abort()
            return
        who = 'another machine or a program that has ended' if account is None else f'uid {account}'
        made = _TurnedAway(_TEXT.format(owner=os.getuid(), who=who).encode())
        self._turned_away.add(made)
        _hand_over(transport, made)


class _Arriving(asyncio.Protocol):
    """A connection of whom nobody knows yet."""

    def __init__(self, admit: Callable[[asyncio.Transport], None]) -> None:
        self._admit = admit

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._admit(cast(asyncio.Transport, transport))


class _TurnedAway(asyncio.Protocol):
    """Is told why as soon as it has said anything, and cut off if it says nothing."""

    def __init__(self, text: bytes) -> None:
        self._answer = _REFUSAL.format(length=len(text)).encode() + text
        self.transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast(asyncio.Transport, transport)
        asyncio.get_running_loop().call_later(TURNED_AWAY_WITHIN_S, transport.abort)  # type: ignore[attr-defined]

    def data_received(self, data: bytes) -> None:
        del data
        if self.transport is not None and not self.transport.is_closing():
            self.transport.write(self._answer)
            self.transport.close()


def _is_gone(transport: asyncio.Transport) -> bool:
    """Whether it is closed, or will be at once: `abort` of asyncio fails on a closed one."""
    return transport.is_closing() and not transport.get_write_buffer_size()


def _hand_over(transport: asyncio.Transport, protocol: asyncio.Protocol) -> None:
    transport.set_protocol(protocol)
    protocol.connection_made(transport)
