"""A node: its ends, and what it sees of others."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from typing import Any

from rclpy import network
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.context import Context, get_default_context
from rclpy.ends import Client, Publisher, Service, Subscription
from rclpy.generated import generated_class
from rclpy.qos import QoSProfile

_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*', re.ASCII)
_TOPIC = re.compile(r'(/[A-Za-z_][A-Za-z0-9_]*)+', re.ASCII)


@dataclass
class TopicEndpointInfo:
    node_name: str
    node_namespace: str
    topic_type: str
    qos_profile: QoSProfile


class _Logger:
    def __init__(self, name: str) -> None:
        self._name = name

    def error(self, text: str) -> None:
        sys.stderr.write(f'[ERROR] [{self._name}]: {text}\n')

    def warning(self, text: str) -> None:
        sys.stderr.write(f'[WARN] [{self._name}]: {text}\n')


class Node:
    """rclpy's, with what every one has: the topic /parameter_events, and no more when nothing is asked for."""

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        start_parameter_services: bool = True,
        parameter_overrides: Any = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        del cli_args, parameter_overrides, allow_undeclared_parameters
        if use_global_arguments or enable_rosout or start_parameter_services or enable_logger_service:
            raise NotImplementedError('the emulator makes bare nodes only')
        del automatically_declare_parameters_from_overrides
        self.context = context or get_default_context()
        if not self.context.ok():
            raise RuntimeError('NotInitializedException: cannot create node')
        if not _NAME.fullmatch(node_name):
            raise RuntimeError(f'InvalidNodeNameException: {node_name}')
        self._name = node_name
        self._namespace = f'/{(namespace or "").strip("/")}'
        self.executor: Any = None
        self.publisher_ends: list[Publisher] = []
        self.subscription_ends: list[Subscription] = []
        self.service_ends: list[Service] = []
        self.client_ends: list[Client] = []
        self._default_group = MutuallyExclusiveCallbackGroup()
        self.context.track_node(self)
        with network.LOCK:
            network.NODES.append(self)
        self.create_publisher(
            generated_class('rcl_interfaces/msg/ParameterEvent'), '/parameter_events', QoSProfile(depth=1000)
        )

    def entities(self) -> list[Any]:
        """What an executor waits for."""
        return [*self.subscription_ends, *self.client_ends, *self.service_ends]

    def get_name(self) -> str:
        return self._name

    def get_fully_qualified_name(self) -> str:
        return f'{self._namespace.rstrip("/")}/{self._name}'

    def get_logger(self) -> _Logger:
        return _Logger(f'{self._namespace}/{self._name}'.strip('/').replace('/', '.'))

    # --- making and unmaking --------------------------------------------------------------------------------

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any) -> Publisher:
        made = Publisher(self, msg_type, _checked(topic), _profile(qos_profile))
        self.publisher_ends.append(made)
        return made

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, qos_profile: Any, *, callback_group: Any = None,
        raw: bool = False,
    ) -> Subscription:  # fmt: skip
        group = callback_group or self._default_group
        made = Subscription(self, msg_type, _checked(topic), callback, _profile(qos_profile), group, raw)
        self.subscription_ends.append(made)
        network.welcome(made)
        return made

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, *, callback_group: Any = None) -> Service:
        made = Service(self, srv_type, _checked(srv_name), callback, callback_group or self._default_group)
        self.service_ends.append(made)
        return made

    def create_client(self, srv_type: Any, srv_name: str, *, callback_group: Any = None) -> Client:
        made = Client(self, srv_type, _checked(srv_name), callback_group or self._default_group)
        self.client_ends.append(made)
        return made

    def destroy_publisher(self, publisher: Publisher) -> bool:
        return _destroy(publisher, self.publisher_ends)

    def destroy_subscription(self, subscription: Subscription) -> bool:
        return _destroy(subscription, self.subscription_ends)

    def destroy_service(self, service: Service) -> bool:
        return _destroy(service, self.service_ends)

    def destroy_client(self, client: Client) -> bool:
        return _destroy(client, self.client_ends)

    def destroy_node(self) -> None:
        with network.LOCK:
            if self in network.NODES:
                network.NODES.remove(self)
        for ends in (self.publisher_ends, self.subscription_ends, self.service_ends, self.client_ends):
            for end in list(ends):
                _destroy(end, ends)

    # --- the graph ------------------------------------------------------------------------------------------

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(node._name, node._namespace) for node in network.neighbours(self)]

    def get_topic_names_and_types(self, no_demangle: bool = False) -> list[tuple[str, list[str]]]:
        assert not no_demangle
        found: dict[str, set[str]] = {}
        for node in network.neighbours(self):
            for end in [*node.publisher_ends, *node.subscription_ends]:
                found.setdefault(end.topic, set()).add(end.msg_type.__msgtype__)
        return [(topic, sorted(kinds)) for topic, kinds in sorted(found.items())]

    def get_publishers_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        assert not no_mangle
        return [
            _info(end) for node in network.neighbours(self) for end in node.publisher_ends if end.topic == topic_name
        ]

    def get_subscriptions_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        assert not no_mangle
        nodes = network.neighbours(self)
        return [_info(end) for node in nodes for end in node.subscription_ends if end.topic == topic_name]

    def get_service_names_and_types(self) -> list[tuple[str, list[str]]]:
        """Those that clients ask for too: DDS has a topic for requests and one for answers, whoever is at its ends."""
        found: dict[str, set[str]] = {}
        for node in network.neighbours(self):
            for end in [*node.service_ends, *node.client_ends]:
                found.setdefault(end.srv_name, set()).add(end.srv_type.__msgtype__)
        return [(service, sorted(kinds)) for service, kinds in sorted(found.items())]

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> list[tuple[str, list[str]]]:
        wanted = (node_name, node_namespace)
        nodes = [node for node in network.neighbours(self) if (node._name, node._namespace) == wanted]
        if not nodes:
            raise RuntimeError(f'NodeNameNonExistentError: {node_name}')
        return [pair for node in nodes for pair in node.own_services()]

    def own_services(self) -> list[tuple[str, list[str]]]:
        return [(end.srv_name, [end.srv_type.__msgtype__]) for end in self.service_ends]


def _info(end: Any) -> TopicEndpointInfo:
    return TopicEndpointInfo(end.node._name, end.node._namespace, end.msg_type.__msgtype__, end.qos_profile)


def _checked(name: str) -> str:
    if not _TOPIC.fullmatch(name):
        raise RuntimeError(f'InvalidTopicNameException: {name}; the emulator takes full names only')
    return name


def _profile(given: Any) -> QoSProfile:
    return given if isinstance(given, QoSProfile) else QoSProfile(depth=given)


def _destroy(end: Any, ends: list[Any]) -> bool:
    with network.LOCK:
        if end not in ends:
            return False
        ends.remove(end)
        end.destroyed = True
    return True
