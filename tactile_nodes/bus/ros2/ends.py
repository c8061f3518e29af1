"""The ends of topics and services on a ROS 2 graph: bytes in, bytes out."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from tactile_nodes import messages
from tactile_nodes.bus.freezing import freeze_arrays
from tactile_nodes.bus.protocol import Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import Clock, wall_ns
from tactile_nodes.errors import BusError

_UNTOLD = 1 << 63  # RMW_MESSAGE_INFO_SEQUENCE_NUMBER_UNSUPPORTED is above


class Ros2Publisher:
    """Publishes our CDR bytes through an rclpy publisher."""

    def __init__(self, topic: str, type_name: str, handle: Any, on_close: Callable[[], None]) -> None:
        self.topic = topic
        self.type_name = type_name
        self.shut = False
        self._handle = handle
        self._on_close = on_close
        self._lock = threading.Lock()

    @property
    def listeners(self) -> int:
        """How many subscriptions get what is published now, in whichever process."""
        with self._lock:
            return 0 if self.shut else int(self._handle.get_subscription_count())

    def publish(self, message: Any) -> None:
        if message.__msgtype__ != self.type_name:
            raise BusError(f'{self.topic} carries {self.type_name}, not {messages.type_name(message)}')
        freeze_arrays(message)  # as on the other buses, where it is shared
        self.publish_bytes(messages.encode(message))

    def publish_bytes(self, data: bytes) -> None:
        with self._lock:
            if self.shut:
                raise BusError(f'the publisher of {self.topic} is closed')
            try:
                self._handle.publish(bytes(data))  # rclpy takes bytes proper, and passes them on as they are
            except RuntimeError as error:  # RCLError, as of a middleware that has no room left
                raise BusError(f'ROS 2 did not publish a message on {self.topic} ({error})') from error

    def close(self) -> None:
        with self._lock:
            if self.shut:
                return
            self.shut = True
            self._on_close()


class Ros2Service:
    def __init__(self, name: str, node: str, on_close: Callable[[], None]) -> None:
        self.name = name
        self.node = node
        self.shut = False
        self._on_close = on_close

    def close(self) -> None:
        if not self.shut:
            self.shut = True
            self._on_close()


def receiving(subscription: Subscription, clock: Clock, *, informed: bool = True) -> Callable[..., None]:
    """rclpy's callback for a raw subscription: of the bytes and, if `informed`, of their rmw_message_info_t.

    Humble's rclpy passes the bytes alone; later ones pass both to a callback that cannot be called with one.

    rclpy tells no publisher, so messages are counted as they come in: `sequence` shows no losses on the way. It begins
    with the publisher's own number where the middleware tells that (`publication_sequence_number` of
    rmw_message_info_t: Fast DDS), else with 2: nobody knows whether others came before. ROS 2's wall-clock time of
    publishing is brought to the host's time base here, once.
    """
    numbers: Iterator[int] | None = None
    publisher = f'ros2:{subscription.topic}'

    def receive(data: bytes, info: dict[str, Any]) -> None:
        nonlocal numbers
        now_ns = clock.now_ns()
        if numbers is None:
            first = int(info.get('publication_sequence_number') or 0)
            numbers = itertools.count(first if 0 < first < _UNTOLD else 2)
        published_ns = int(info.get('source_timestamp') or 0)
        source_ns = published_ns + now_ns - wall_ns() if published_ns > 0 else now_ns
        subscription.put(Received(subscription.type_name, publisher, next(numbers), source_ns, now_ns, data=data))

    return receive if informed else partial(receive, info={})
