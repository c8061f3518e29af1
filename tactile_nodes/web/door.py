"""Decides who may connect to a server. It checks a new connection before reading any byte of it."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from typing import Any, cast
from weakref import WeakKeyDictionary, WeakSet

from tactile_nodes.web import accounts

MOST_CONNECTIONS = 128  # for owners, and the same number for guests
MOST_TURNED_AWAY = 32  # at once; further ones are closed without a response
TURNED_AWAY_WITHIN_S = 5.0
_REFUSAL = (
    'HTTP/1.1 403 Forbidden\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {length}\r\n'
    'Connection: close\r\nX-Content-Type-Options: nosniff\r\n\r\n'
)
_TEXT = (
    'This server is for the user who started it (uid {owner}), and this request comes from {who}. '
    'Open it as that user on that machine; from another machine use an ssh tunnel. '
    'To allow others, see "guests" in the documentation.\n'
)


class Door:
    """Admits programs of the `owners` and, if `guests` is set, everyone; knows which connection is which.

    Guests can use up all guest connections, but none of an owner's. `refused` counts the refused connections.
    """

    def __init__(self, *, guests: bool, owners: frozenset[int] | None = None) -> None:
        self.refused = 0
        self._owners = accounts.owners() if owners is None else owners
        self._guests = guests
        self._inside: WeakKeyDictionary[asyncio.BaseTransport, bool] = WeakKeyDictionary()
        self._turned_away: WeakSet[_TurnedAway] = WeakSet()

    def is_owner(self, transport: asyncio.BaseTransport | None) -> bool:
        """Whether an admitted connection is an owner's."""
        return transport is not None and self._inside.get(transport, False)

    def opening_to(self, serve: Callable[[], Any]) -> Callable[[], asyncio.Protocol]:
        """The protocol factory for asyncio; `serve` creates the protocol for admitted connections."""
        return lambda: _Arriving(lambda transport: self._admit(transport, serve))

    def close(self) -> None:
        """Close all open connections, even with unsent data."""
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
        turned_away = _TurnedAway(_TEXT.format(owner=os.getuid(), who=who).encode())
        self._turned_away.add(turned_away)
        _hand_over(transport, turned_away)


class _Arriving(asyncio.Protocol):
    """A connection that is not identified yet."""

    def __init__(self, admit: Callable[[asyncio.Transport], None]) -> None:
        self._admit = admit

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._admit(cast(asyncio.Transport, transport))


class _TurnedAway(asyncio.Protocol):
    """Sends the reason after the first received byte; closes the connection if none comes."""

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
    """Whether it is closed, or about to be closed: `abort` of asyncio fails on a closed one."""
    return transport.is_closing() and not transport.get_write_buffer_size()


def _hand_over(transport: asyncio.Transport, protocol: asyncio.Protocol) -> None:
    transport.set_protocol(protocol)
    protocol.connection_made(transport)
