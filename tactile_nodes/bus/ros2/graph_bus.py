"""The bus of a ROS 2 graph: rclpy below, our CDR bytes through it, the same nodes above.

Each node of ours is an rclpy node of its full name, with its publishers, subscriptions and services; a hidden one looks
at the graph and calls services. One thread a process spins them all; callbacks of ours run in their nodes' threads, as
on the other buses. rclpy sees no command line: names, namespaces, remaps and parameters are ours (`arguments.py`).
"""

from __future__ import annotations

import os
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node as RclpyNode
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription as RclpySubscription

from tactile_nodes.bus.inprocess import new_uid
from tactile_nodes.bus.protocol import Graph, Qos, ServiceHandler
from tactile_nodes.bus.ros2 import calls as ros2_calls
from tactile_nodes.bus.ros2 import events as ros2_events
from tactile_nodes.bus.ros2.ends import Ros2Publisher, Ros2Service, receiving
from tactile_nodes.bus.ros2.graph import LONGEST_S, read_graph, wait_until_settled
from tactile_nodes.bus.ros2.qos import publisher_profile, subscription_profile
from tactile_nodes.bus.ros2.types import generated_class
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import NS_PER_S, Clock, SystemClock, monotonic_s, wall_ns
from tactile_nodes.errors import BusError, ServiceError
from tactile_nodes.messages import services, types

End = TypeVar('End')

_END_WITHIN_S = 1.0
_LOOK_AGAIN_S = 1.0
_UNANSWERED_S = 0.2  # for calls whose answers do not come any more
_CLOCKS_APART_NS = 10_000_000


class Ros2Bus:
    """`Bus` over rclpy.

    Raises:
        BusError: ROS 2 cannot be joined.
    """

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self.uid = new_uid()
        self._lock = threading.RLock()
        self._nodes: dict[str, list[Any]] = {}
        self._clients: dict[tuple[str, str], Any] = {}
        self._events: dict[str, Ros2Publisher] = {}
        self._ends: list[Any] = []
        self._closed = False
        self._opened_s = monotonic_s()
        self._settled = False  # what is seen of the graph
        self._context = Context()
        try:
            # With no arguments and no handlers: both are this package's own, on every bus.
            rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
            self._executor = SingleThreadedExecutor(context=self._context)
            self._looker = self._make_node(f'/_tactile_{os.getpid()}_{self.uid}')
        except RuntimeError as error:  # RCLError is one
            raise BusError(f'cannot join ROS 2: {error}; is ROS_DOMAIN_ID right, and RMW_IMPLEMENTATION?') from error
        self._say_when_clocks_differ()
        self._thread = threading.Thread(target=self._spin, name='rclpy', daemon=True)
        self._thread.start()

    # --- topics ---------------------------------------------------------------------------------------------

    def advertise(self, topic: str, type_name: str, qos: Qos, node: str = '') -> Ros2Publisher:
        generated = generated_class(type_name)
        with self._lock:
            self._check_open()
            owner = self._node(node)
            with _making(f'publish {topic} as {type_name}'):
                publisher = owner.create_publisher(generated, topic, publisher_profile(topic, qos))
            return self._keep(Ros2Publisher(topic, type_name, publisher, lambda: owner.destroy_publisher(publisher)))

    def subscribe(
        self, topic: str, type_name: str, qos: Qos, node: str = '', on_ready: Callable[[], None] | None = None
    ) -> Subscription:
        generated = generated_class(type_name)
        with self._lock:
            self._check_open()
            owner = self._node(node)
            handles: list[Any] = []

            def forget(closed: Subscription) -> None:
                for handle in handles:
                    owner.destroy_subscription(handle)
                with self._lock:
                    self._ends = [end for end in self._ends if end is not closed]

            subscription = Subscription(topic, type_name, qos, node, on_ready, forget)
            there = [end for end in owner.get_publishers_info_by_topic(topic) if end.topic_type == type_name]
            profile = subscription_profile(topic, qos, there)
            callback = receiving(subscription, self.clock, informed=hasattr(RclpySubscription, 'CallbackType'))
            with _making(f'subscribe to {topic} as {type_name}'):
                handles.append(owner.create_subscription(generated, topic, callback, profile, raw=True))
            return self._keep(subscription)

    # --- services -------------------------------------------------------------------------------------------

    def serve(self, service: str, type_name: str, handler: ServiceHandler, node: str = '') -> Ros2Service:
        generated = generated_class(type_name)
        with self._lock:
            self._check_open()
            for end in self._ends:
                if isinstance(end, Ros2Service) and end.name == service and not end.shut:
                    raise BusError(f'the service {service} is already offered by {end.node}')
            owner = self._node(node)
            if type_name in ros2_events.SETTING:
                handler = ros2_events.with_events(handler, node, self.clock.now_ns, self._events_of(node).publish)
            answer = ros2_calls.answering(type_name, handler, self._executor, owner.get_logger().error)
            # Its own group: calls that wait for their answer hold up neither each other nor any topic.
            with _making(f'offer {service} as {type_name}'):
                service_end = owner.create_service(generated, service, answer, callback_group=ReentrantCallbackGroup())
            return self._keep(Ros2Service(service, node, lambda: owner.destroy_service(service_end)))

    def call(self, service: str, type_name: str, request: Any, timeout_s: float = 5.0) -> Any:
        self._check_open()
        try:
            client = self._client(service, type_name)
            return ros2_calls.call(client, type_name, request, timeout_s, lambda: self._served_as(service))
        except RuntimeError as error:  # RCLError, and InvalidHandle when the bus is closed meanwhile
            raise BusError(f'ROS 2 could not call {service} ({error})') from error

    def ping(self, uid: str, timeout_s: float = 1.0) -> float | None:
        """The seconds that the node of this full name took to list its parameters; None when it did not."""
        begin_s = monotonic_s()
        try:
            self.call(f'{uid}/list_parameters', services.LIST_PARAMETERS, types.ListParameters_Request(), timeout_s)
        except ServiceError:
            return None
        return monotonic_s() - begin_s

    # --- the graph ------------------------------------------------------------------------------------------

    def add_node(self, name: str) -> None:
        with self._lock:
            self._check_open()
            with _making(f'show the node {name}'):
                made = self._make_node(name)
            self._nodes.setdefault(name, []).append(made)

    def remove_node(self, name: str) -> None:
        with self._lock:
            rclpy_node = self._nodes.get(name)
            if rclpy_node:
                if events := self._events.pop(name, None):
                    events.close()
                self._drop_node(rclpy_node.pop())

    def graph(self) -> Graph:
        self._check_open()
        if not self._settled:
            # Nodes look again, and have to end when asked to; whoever has none looks once.
            longest_s = _LOOK_AGAIN_S if self._nodes else LONGEST_S
            wait_until_settled(self._looker, self._opened_s, longest_s)
            self._settled = True
        return read_graph(self._looker)

    def close(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
            ends = [*self._ends]
        for end in ends:
            end.close()
        self._executor.create_task(_nothing)  # a spin ends when something was done, not when it is woken
        self._thread.join(_END_WITHIN_S)
        with self._lock:
            for node in [self._looker, *(node for nodes in self._nodes.values() for node in nodes)]:
                self._drop_node(node)
            self._nodes.clear()
        self._executor.shutdown(timeout_sec=_UNANSWERED_S)
        self._context.try_shutdown()

    # --- inside ---------------------------------------------------------------------------------------------

    def _spin(self) -> None:
        while not self._closed and self._context.ok():
            try:
                self._executor.spin_once()
            except ExternalShutdownException:
                return
            except Exception:  # noqa: BLE001 - what one callback did wrong must not end receiving for all
                if not self._closed:
                    self._looker.get_logger().error(traceback.format_exc())

    def _make_node(self, name: str) -> Any:
        namespace, _, short = name.rpartition('/')
        # No rosout, parameters or services of rclpy's: each of our nodes publishes and serves its own.
        rclpy_node = RclpyNode(
            short,
            namespace=namespace or '/',
            context=self._context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor.add_node(rclpy_node)
        return rclpy_node

    def _drop_node(self, node: Any) -> None:
        self._executor.remove_node(node)
        node.destroy_node()

    def _node(self, name: str) -> Any:
        return (self._nodes.get(name) or [self._looker])[-1]

    def _events_of(self, node: str) -> Ros2Publisher:
        if node not in self._events:
            publisher = self.advertise(ros2_events.EVENTS, ros2_events.EVENT_TYPE, ros2_events.EVENT_QOS, node)
            self._events[node] = publisher
        return self._events[node]

    def _client(self, service: str, type_name: str) -> Any:
        with self._lock:
            key = (service, type_name)
            if key not in self._clients:
                group = ReentrantCallbackGroup()
                self._clients[key] = self._looker.create_client(
                    generated_class(type_name), service, callback_group=group
                )
            return self._clients[key]

    def _served_as(self, service: str) -> str | None:
        # Not get_service_names_and_types: that lists the types of clients too, the one that asks here among them.
        return next((end.type_name for end in read_graph(self._looker).services(service)), None)

    def _keep(self, end: End) -> End:
        self._ends = [kept for kept in self._ends if not getattr(kept, 'shut', False)]
        self._ends.append(end)
        return end

    def _check_open(self) -> None:
        if self._closed:
            raise BusError('the bus is closed')

    def _say_when_clocks_differ(self) -> None:
        # The least of a few: between two readings others may run.
        apart_ns = min((self.clock.now_ns() - wall_ns() for _ in range(5)), key=abs)
        if abs(apart_ns) > _CLOCKS_APART_NS:
            self._looker.get_logger().warning(
                f'stamps of this package are {apart_ns / NS_PER_S:+.3f} s from the wall clock that other nodes use: '
                'it was set after the first program of this boot; end all programs and remove clock-* (docs/ros2.md)'
            )


@contextmanager
def _making(what: str) -> Iterator[None]:
    """Tell in a sentence what the middleware refuses to make: Fast DDS allows one type a name in each process."""
    try:
        yield
    except RuntimeError as error:  # RCLError is one
        said = str(error).partition('\n')[0]
        raise BusError(
            f'ROS 2 cannot {what} ({said}); if this process uses that name with another type, remap one of them'
        ) from error


def _nothing() -> None:
    """What there is to do when the bus is left."""
