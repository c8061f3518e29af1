"""Calls of services that cross a bridge: those that we passed on and wait for, those that we answer."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from typing import Any

from tactile_nodes import messages
from tactile_nodes.bus.protocol import Reply
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.errors import MessageError, ServiceError, ServiceUnavailableError, TactileError
from tactile_nodes.messages.services import request_type, response_type

_CALL_S = 30.0
_MOST_CALLS = 64


class BridgeCalls:
    """Used by the bridge's thread alone; the calls that it answers run in threads of their own."""

    def __init__(self) -> None:
        self._waiting: dict[bytes, tuple[bytes, str, Reply]] = {}
        self._free = threading.Semaphore(_MOST_CALLS)

    def ask(self, peer: bytes, name: str, type_name: str, data: bytes, reply: Reply) -> list[bytes]:
        """Remember who waits; the frames that ask."""
        call_id = secrets.token_bytes(8)
        self._waiting[call_id] = (peer, type_name, reply)
        return [b'call', call_id, name.encode(), type_name.encode(), data]

    def hear(self, call_id: bytes, outcome: bytes, data: bytes) -> None:
        """An answer has come."""
        _, type_name, reply = self._waiting.pop(call_id)
        if outcome != b'ok':
            reply(ServiceError(data.decode(errors='replace')))
            return
        try:
            reply(messages.decode(data, response_type(type_name)))
        except MessageError as error:
            reply(error)

    def lose(self, peer: bytes, host: str) -> None:
        """No answers will come from there."""
        for call_id in [call_id for call_id, (asked, _, _) in self._waiting.items() if asked == peer]:
            _, _, reply = self._waiting.pop(call_id)
            reply(ServiceUnavailableError(f'the connection to {host} was lost during the call'))

    def answer(self, bus: ZmqBus, allowed: bool, call: list[bytes], send: Callable[[list[Any]], None]) -> None:
        """Have a service of this machine called for another one, and `send` what it says.

        Raises:
            MessageError, ValueError: no call.
        """
        call_id, name, type_name, data = call
        service, kind = name.decode(), type_name.decode()
        request = messages.decode(data, request_type(kind))

        def work() -> None:
            try:
                response = messages.encode(bus.call_here(service, kind, request, _CALL_S))
                send([b'answer', call_id, b'ok', response])
            except TactileError as error:
                send([b'answer', call_id, b'error', str(error).encode()])
            finally:
                self._free.release()

        if not allowed:
            send([b'answer', call_id, b'error', f'{service} may not be called from other machines'.encode()])
        elif not self._free.acquire(blocking=False):
            send([b'answer', call_id, b'error', b'too many calls at once'])
        else:
            threading.Thread(target=work, name='bridge call', daemon=True).start()
