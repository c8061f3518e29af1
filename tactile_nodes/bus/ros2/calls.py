"""Services over rclpy: answered in the node's own thread, asked for from any but the executor's."""

from __future__ import annotations

import dataclasses
import threading
import traceback
from collections.abc import Callable
from typing import Any

from rclpy.task import Future

from tactile_nodes import messages
from tactile_nodes.bus.inprocess import require_type
from tactile_nodes.bus.protocol import ServiceHandler
from tactile_nodes.bus.ros2.types import generated_class, to_ours, to_theirs
from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import MessageError, ServiceError, ServiceTimeoutError, ServiceUnavailableError, TactileError
from tactile_nodes.messages import services, types
from tactile_nodes.messages.services import request_type, response_type

_FIND_WITHIN_S = 2.0  # discovery on a busy network
_BUG = 'the service failed because of a bug'


def answering(type_name: str, handler: ServiceHandler, executor: Any, tell: Callable[[str], None]) -> Any:
    """rclpy's callback for a service that `handler` answers, at once or later, from any thread.

    It is a coroutine: while it waits, the executor goes on with other work. `tell` takes what went wrong where the
    type of the response has no field for that.
    """
    generated = generated_class(type_name)

    async def answer(request: Any, response: Any) -> Any:
        del response  # made anew, from bytes
        pending = Future(executor=executor)

        def reply(result: Any) -> None:
            pending.set_result(result)
            executor.wake()  # before rclpy 7.1.9 nothing else looks at a waiting coroutine

        our_request: Any = None
        try:
            our_request = to_ours(request, request_type(type_name))
            handler(our_request, reply)
            result = await pending
            if not isinstance(result, Exception):
                return to_theirs(result, response_type(type_name), generated.Response)
        except TactileError as error:
            result = error
        except Exception:  # noqa: BLE001 - the executor's thread serves everybody, and must not end
            tell(traceback.format_exc())
            result = ServiceError(_BUG)
        tell(f'a call of {type_name} failed: {result}')
        return to_theirs(_refusal(type_name, our_request, result), response_type(type_name), generated.Response)

    return answer


def call(client: Any, type_name: str, request: Any, timeout_s: float, served_as: Callable[[], str | None]) -> Any:
    """The response to `request`; `served_as` looks up as which type the service is served, if at all.

    Raises what `Bus.call` raises.
    """
    deadline_s = monotonic_s() + timeout_s
    generated = generated_class(type_name)
    theirs = to_theirs(request, request_type(type_name), generated.Request)
    if not client.wait_for_service(timeout_sec=min(timeout_s, _FIND_WITHIN_S)):
        found = served_as()
        if found is not None:
            require_type(client.srv_name, found, type_name)
        raise ServiceUnavailableError(f'no node offers the service {client.srv_name}; see: tactile service list')
    answered = threading.Event()
    future = client.call_async(theirs)
    future.add_done_callback(lambda _: answered.set())
    if not answered.wait(max(0.0, deadline_s - monotonic_s())):
        client.remove_pending_request(future)
        raise ServiceTimeoutError(
            f'no response from {client.srv_name} within {timeout_s:g} s; its node is busy or stuck'
        )
    try:
        return to_ours(future.result(), response_type(type_name))
    except MessageError as error:
        raise ServiceError(f'invalid response from {client.srv_name}: {error}') from error


def _refusal(type_name: str, request: Any, error: Exception) -> Any:
    """A response that says no, as far as its type has words for it: ROS 2 has no other way to tell a caller."""
    text = str(error)
    if type_name == services.SET_PARAMETERS:
        no = types.SetParametersResult(successful=False, reason=text)
        return types.SetParameters_Response(results=[no for _ in getattr(request, 'parameters', ())])
    if type_name == services.SET_PARAMETERS_ATOMICALLY:
        no = types.SetParametersResult(successful=False, reason=text)
        return types.SetParametersAtomically_Response(result=no)
    response = messages.message_class(response_type(type_name))
    fields = {field.name for field in dataclasses.fields(response)}
    if {'success', 'message'} <= fields:
        return response(success=False, message=text)
    return response()
