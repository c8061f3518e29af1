"""Calls of services between processes: one address a participant answers, one socket a call asks."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zmq

from tactile_nodes import messages
from tactile_nodes.bus.protocol import ServiceHandler
from tactile_nodes.bus.zeromq import wire
from tactile_nodes.bus.zeromq.loop import Loop
from tactile_nodes.bus.zeromq.sockets import Longest, open_socket
from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import (
    BusError,
    MessageError,
    ServiceError,
    ServiceTimeoutError,
    ServiceUnavailableError,
    TactileError,
)
from tactile_nodes.messages.services import request_type, response_type

_LOOK_EVERY_MS = 100
_AT_ONCE = 100  # calls taken in before messages get their turn again

FindService = Callable[[str, str], ServiceHandler | None]
"""The handler of a service of this name and type."""


class CallServer:
    """Answers the calls and pings of other processes. Its socket is used by the hub's thread alone."""

    def __init__(self, context: zmq.Context[Any], address: str, find: FindService, hub: Loop) -> None:
        self.address = address
        self.malformed = 0
        self._find = find
        self._hub = hub
        self._socket = open_socket(context, zmq.ROUTER, Longest.CALL)
        self._socket.set(zmq.LINGER, 200)
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            raise BusError(f'cannot answer calls at {address}: {error.strerror}') from error
        hub.watch(self._socket, self._take_in)

    def bind_again(self, address: str) -> None:
        """Be reachable once more after the folder of the sockets was removed."""
        bind_again(self._socket, self.address, address)
        self.address = address

    def close(self) -> None:
        self._socket.close()

    def _take_in(self) -> None:
        for _ in range(_AT_ONCE):
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
        kind = type_name.decode()
        handler = self._find(name.decode(), kind)
        if handler is None:
            self._refuse(caller, call_id, 'this type of the service is not offered here')
            return
        try:
            request = messages.decode(data, request_type(kind))
        except MessageError as error:
            self._refuse(caller, call_id, str(error))
            raise
        try:
            handler(request, lambda response: self._hub.post(lambda: self._answer(caller, call_id, kind, response)))
        except TactileError as error:
            self._refuse(caller, call_id, str(error))
        except Exception:
            self._refuse(caller, call_id, 'the service failed because of a bug')
            raise

    def _answer(self, caller: bytes, call_id: bytes, kind: str, response: Any) -> None:
        if isinstance(response, Exception):
            self._refuse(caller, call_id, str(response))
            return
        try:
            data = _encoded(response, response_type(kind))
        except MessageError as error:
            self._refuse(caller, call_id, str(error))
            return
        self._send([caller, wire.ANSWER, call_id, b'ok', data])

    def _refuse(self, caller: bytes, call_id: bytes, text: str) -> None:
        self._send([caller, wire.ANSWER, call_id, b'error', text.encode()])

    def _send(self, frames: list[bytes]) -> None:
        try:
            self._socket.send_multipart(frames, zmq.NOBLOCK)
        except zmq.ZMQError:  # the caller is gone, and nobody else wants the answer
            self.malformed += 1


def bind_again(socket: Any, old: str, new: str) -> None:
    """Bind a socket whose file was removed; those who are connected stay so.

    Raises:
        BusError: its folder was removed again meanwhile, or the disk is full; it can be tried once more.
    """
    if old == new and is_bound(old):
        return
    with contextlib.suppress(zmq.ZMQError):  # an attempt that failed has left it unbound
        socket.unbind(old)
    try:
        socket.bind(new)
    except zmq.ZMQError as error:
        raise BusError(f'cannot be reached at {new}: {os.strerror(error.errno or 0)}') from error


def is_bound(address: str) -> bool:
    """Whether the file of a socket's address is still there."""
    return Path(address.removeprefix('ipc://')).exists()


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
    frames = [service.encode(), type_name.encode(), _encoded(request, request_type(type_name))]
    answer = _ask(context, address, wire.CALL, frames, timeout_s, is_alive)
    if answer is None:
        if not is_alive():
            raise ServiceUnavailableError(f'the process that served {service} has ended')
        raise ServiceTimeoutError(
            f'no response from {service} within {timeout_s:g} s; its node is alive but busy or stuck'
        )
    outcome, data = answer
    if outcome != b'ok':
        raise ServiceError(f'{service}: {data.decode(errors="replace")}')
    try:
        return messages.decode(data, response_type(type_name))
    except MessageError as error:
        raise ServiceError(f'invalid response from {service}: {error}') from error


def ping_remote(context: zmq.Context[Any], address: str, timeout_s: float) -> float | None:
    """The seconds until the participant at `address` answered, or None."""
    start_s = monotonic_s()
    answer = _ask(context, address, wire.PING, [], timeout_s, lambda: True)
    return monotonic_s() - start_s if answer is not None else None


def _encoded(message: Any, type_name: str) -> bytes:
    found = getattr(message, '__msgtype__', type(message).__name__)
    if found != type_name:
        raise MessageError(f'expected a {type_name}, not a {found}')
    data = messages.encode(message)
    if len(data) > Longest.CALL:
        raise MessageError(f'a {type_name} of {len(data)} bytes: the limit of a call is {Longest.CALL}')
    return data


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
    try:
        with open_socket(context, zmq.DEALER, Longest.CALL) as socket:
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
    except zmq.ZMQError as error:
        raise BusError(f'a call was interrupted ({error.strerror}); was the bus closed meanwhile?') from error
    return None
