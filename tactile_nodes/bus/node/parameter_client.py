"""A node's parameters, asked for through the services that each node serves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tactile_nodes.bus.node.parameters import from_message, to_message
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.errors import BusError, ConfigurationError
from tactile_nodes.messages import services, types
from tactile_nodes.params import Value

TIMEOUT_S = 5.0


class ParameterClient:
    """The parameters of the node of this full name.

    Each method raises a ServiceError when the node does not answer; making one raises a BusError when there is no
    such node.
    """

    def __init__(self, bus: Bus, node: str, timeout_s: float = TIMEOUT_S) -> None:
        if not bus.graph().services(f'{node}/list_parameters'):
            raise BusError(f'there is no node {node} with parameters; see tactile node list')
        self._bus = bus
        self._node = node
        self._timeout_s = timeout_s

    def names(self, prefixes: Iterable[str] = ()) -> list[str]:
        """All names, sorted; only those below `prefixes` when some are given."""
        request = types.ListParameters_Request(prefixes=list(prefixes))
        answer = self._call('list_parameters', services.LIST_PARAMETERS, request)
        return sorted(answer.result.names)

    def values(self, names: list[str]) -> dict[str, Value | None]:
        """The value of each; None for a name that the node does not have."""
        answer = self._call('get_parameters', services.GET_PARAMETERS, types.GetParameters_Request(names=names))
        found = zip(names, map(from_message, answer.values), strict=False)  # rclcpp gives none if one does not exist
        return {**dict.fromkeys(names), **dict(found)}

    def descriptors(self, names: list[str]) -> list[types.ParameterDescriptor]:
        request = types.DescribeParameters_Request(names=names)
        found = self._call('describe_parameters', services.DESCRIBE_PARAMETERS, request).descriptors
        return list(found)

    def set(self, name: str, value: Value) -> None:
        """Change one.

        Raises:
            ConfigurationError: the node refuses; the text is its reason.
        """
        request = types.SetParameters_Request(parameters=[types.Parameter(name=name, value=to_message(value))])
        (result,) = self._call('set_parameters', services.SET_PARAMETERS, request).results
        if not result.successful:
            raise ConfigurationError(result.reason)

    def _call(self, service: str, type_name: str, request: Any) -> Any:
        return self._bus.call(f'{self._node}/{service}', type_name, request, self._timeout_s)
