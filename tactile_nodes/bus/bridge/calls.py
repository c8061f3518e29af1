"""Calls of services that cross a bridge: those that are passed on, and those that are answered."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from tactile_nodes import messages
from tactile_nodes.bus.bridge.talk import fits
from tactile_nodes.bus.protocol import Reply
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.errors import MessageError, ServiceError, ServiceUnavailableError, TactileError
from tactile_nodes.messages.services import request_type, response_type

if TYPE_CHECKING:
    import zenoh

_CALL_S = 30.0
_MOST_CALLS = 64


def pass_on(session: zenoh.Session, key: str, host: str, service: tuple[str, str], request: Any, reply: Reply) -> None:
    """Have a service (its name and type) of `host` called; `reply` is given the response or the error, once."""
    from zenoh.handlers import Callback

    name, type_name = service
    answered = threading.Event()

    def answer(outcome: Any) -> None:
        if not answered.is_set():
            answered.set()
            reply(outcome)

    def hear(came: zenoh.Reply) -> None:
        if came.ok is None:
            answer(ServiceError(came.err.payload.to_bytes().decode(errors='replace') if came.err else 'no answer'))
            return
        try:
            answer(messages.decode(came.ok.payload.to_bytes(), response_type(type_name)))
        except MessageError as error:
            answer(error)

    def lose() -> None:
        answer(ServiceUnavailableError(f'the connection to {host} was lost during the call'))

    data, words = messages.encode(request), f'{name}\n{type_name}'.encode()
    session.get(key, Callback(hear, lose), payload=data, attachment=words, timeout=_CALL_S)


class CallAnswers:
    """Answers calls of services of this machine, each in a thread of its own."""

    def __init__(self, bus: ZmqBus, allowed: tuple[str, ...]) -> None:
        self._bus = bus
        self._allowed = allowed
        self._free = threading.Semaphore(_MOST_CALLS)

    def answer(self, query: zenoh.Query) -> None:
        """Answer one call. Raises one of `MALFORMED`: it is none."""
        if query.payload is None or query.attachment is None:
            raise MessageError('a call without service or request')
        name, _, type_name = query.attachment.to_bytes().decode().partition('\n')
        request = messages.decode(query.payload.to_bytes(), request_type(type_name))
        if not fits(name, self._allowed):
            query.reply_err(f'{name} may not be called from other machines')
        elif not self._free.acquire(blocking=False):
            query.reply_err('too many calls at once')
        else:
            work = (query, name, type_name, request)
            threading.Thread(target=self._call, args=work, name='bridge call', daemon=True).start()

    def _call(self, query: zenoh.Query, name: str, type_name: str, request: Any) -> None:
        try:
            response = messages.encode(self._bus.call_here(name, type_name, request, _CALL_S))
            query.reply(query.key_expr, response)
        except TactileError as error:
            query.reply_err(str(error))
        finally:
            query.drop()
            self._free.release()
