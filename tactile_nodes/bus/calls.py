"""Calls of services between processes: one address a participant answers, one socket a call asks."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import zmq

from tactile_nodes import messages
from tactile_nodes.bus import wire
from tactile_nodes.bus.protocol import ServiceHandler
from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import MessageError, ServiceError, ServiceTimeoutError, ServiceUnavailableError
from tactile_nodes.messages.services import request_type, response_type

if TYPE_CHECKING:
    from tactile_nodes.bus.receiving import Hub

_LOOK_EVERY_MS = 100

FindService = Callable[[str, str], ServiceHandler | None]
"""The handler of a service of this name and type."""


class CallServer:
    """Answers the calls and pings of other processes. Its socket is used by the hub's thread alone."""

    def __init__(self, context: zmq.Context[Any], address: str, find: FindService, hub: Hub) -> None:
        self.address = address
        self.malformed = 0
        self._find = find
        self._hub = hub
        self._socket = context.socket(zmq.ROUTER)
        self._socket.set(zmq.LINGER, 200)
        self._socket.bind(address)
        hub.watch(self._socket, self._take_in)

    def close(self) -> None:
        """Answer no more; after the hub's thread has ended."""
        self._socket.close()

    def _take_in(self) -> None:
        while True:
            try:
                caller, *frames = self._socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            try:
                self._handle(caller, frames)
            except (MessageError, UnicodeDecodeError):
                self.malformed += 1

    def _handle(self, caller: bytes, frames: list[bytes]) -> None:
        if len(frames) == 2 and frames[0] == wire.PING:
            self._send([caller, wire.ANSWER, frames[1], b'ok', b''])
            return
        if len(frames) != 5 or frames[0] != wire.CALL:
            raise MessageError(f'a call of {len(frames)} frames')
        _, call_id, name, type_name, data = frames
        handler = self._find(name.decode(), type_name.decode())
        if handler is None:
            self._send([caller, wire.ANSWER, call_id, b'error', b'it is not served here as this type'])
            return
        request = messages.decode(data, request_type(type_name.decode()))
        handler(request, lambda response: self._hub.post(lambda: self._answer(caller, call_id, response)))

    def _answer(self, caller: bytes, call_id: bytes, response: Any) -> None:
        if isinstance(response, Exception):
            self._send([caller, wire.ANSWER, call_id, b'error', str(response).encode()])
        else:
            self._send([caller, wire.ANSWER, call_id, b'ok', messages.encode(response)])

    def _send(self, frames: list[bytes]) -> None:
        try:
            self._socket.send_multipart(frames, zmq.NOBLOCK)
        except zmq.ZMQError:  # the caller is gone, and nobody else wants the answer
            self.malformed += 1


def call_remote(
    context: zmq.Context[Any],
    address: str,
    service: str,
    type_name: str,
    request: Any,
    timeout_s: float,
    is_alive: Callable[[], bool],
) -> Any:
    """The response of a service of another process. Raises what `Bus.call` raises."""
    frames = [service.encode(), type_name.encode(), messages.encode(request)]
    answer = _ask(context, address, wire.CALL, frames, timeout_s, is_alive)
    if answer is None:
        if not is_alive():
            raise ServiceUnavailableError(f'the process that served {service} has ended')
        raise ServiceTimeoutError(
            f'no answer from {service} within {timeout_s:g} s; its node is alive but busy or stuck'
        )
    outcome, data = answer
    if outcome != b'ok':
        raise ServiceError(f'{service}: {data.decode(errors="replace")}')
    return messages.decode(data, response_type(type_name))


def ping_remote(context: zmq.Context[Any], address: str, timeout_s: float) -> float | None:
    """The seconds until the participant at `address` answered, or None."""
    start_s = monotonic_s()
    answer = _ask(context, address, wire.PING, [], timeout_s, lambda: True)
    return monotonic_s() - start_s if answer is not None else None


def _ask(
    context: zmq.Context[Any],
    address: str,
    kind: bytes,
    frames: list[bytes],
    timeout_s: float,
    is_alive: Callable[[], bool],
) -> tuple[bytes, bytes] | None:
    """Outcome and data of the answer; None when there is none in time or nobody left to give it."""
    deadline_s = monotonic_s() + timeout_s
    call_id = secrets.token_bytes(8)
    with context.socket(zmq.DEALER) as socket:
        socket.set(zmq.LINGER, 0)
        socket.connect(address)
        socket.send_multipart([kind, call_id, *frames])
        while (left_s := deadline_s - monotonic_s()) > 0:
            if not socket.poll(min(_LOOK_EVERY_MS, max(1, int(left_s * 1000)))):
                if not is_alive():
                    return None
                continue
            answer = socket.recv_multipart()
            if len(answer) == 4 and answer[0] == wire.ANSWER and answer[1] == call_id:
                return answer[2], answer[3]
    return None
