"""Informs a ROS 2 graph of parameters that were set, as rclpy's own parameter services do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tactile_nodes.bus.protocol import Qos, Reply, ServiceHandler
from tactile_nodes.messages import services, time_from_ns, types

EVENTS = '/parameter_events'
EVENT_TYPE = 'rcl_interfaces/msg/ParameterEvent'
EVENT_QOS = Qos('queue', 1000)
SETTING = {services.SET_PARAMETERS, services.SET_PARAMETERS_ATOMICALLY}


def with_events(
    handler: ServiceHandler, node: str, now_ns: Callable[[], int], publish: Callable[[Any], None]
) -> ServiceHandler:
    """`handler` of a service that sets parameters of `node`; `publish` gets a ParameterEvent with the ones set."""

    def handle(request: Any, reply: Reply) -> None:
        def then(response: Any) -> None:
            if changed := _set(request, response):
                stamp = time_from_ns(now_ns())
                publish(types.ParameterEvent(stamp=stamp, node=node, changed_parameters=changed))
            reply(response)

        handler(request, then)

    return handle


def _set(request: Any, response: Any) -> list[types.Parameter]:
    if isinstance(response, types.SetParametersAtomically_Response):
        return list(request.parameters) if response.result.successful else []
    if isinstance(response, types.SetParameters_Response):
        pairs = zip(request.parameters, response.results, strict=True)
        return [parameter for parameter, result in pairs if result.successful]
    return []  # an error
