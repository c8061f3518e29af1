"""How a node answers calls: in its own thread, in turn with its messages; what takes long goes before, beside them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from tactile_nodes.bus.protocol import Reply, ServiceHandler
from tactile_nodes.errors import TactileError
from tactile_nodes.messages import types

Answer = Callable[[Any], Any]
Post = Callable[[Callable[[], None]], None]


def in_turn(answer: Answer, post: Post, first: Callable[[Any], None] | None = None) -> ServiceHandler:
    """A handler that has `post` do `answer`; `first` is called with the request before, in a thread of its own."""

    def later(request: Any, reply: Reply) -> None:
        post(lambda: reply(_answered(answer, request)))

    def beside(request: Any, reply: Reply) -> None:
        assert first is not None
        try:
            first(request)
        except TactileError as error:
            reply(error)
        else:
            later(request, reply)

    if first is None:
        return later
    return lambda request, reply: threading.Thread(target=beside, args=(request, reply), daemon=True).start()


def trigger(act: Callable[[], str]) -> Answer:
    """The answer of a std_srvs/Trigger: what `act` returns, or the sentence of the TactileError it raises."""

    def answer(_: types.Trigger_Request) -> types.Trigger_Response:
        try:
            return types.Trigger_Response(success=True, message=act())
        except TactileError as error:
            return types.Trigger_Response(success=False, message=str(error))

    return answer


def _answered(answer: Answer, request: Any) -> Any:
    try:
        return answer(request)
    except TactileError as error:
        return error
