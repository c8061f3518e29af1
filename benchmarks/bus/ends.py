"""The senders and the receivers of the bus benchmark.

One process has all senders and another all receivers, so that contenders take turns under the same conditions. For
the rounds inside one process, a third process has both.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import zmq

from tactile_nodes import messages
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.protocol import Bus, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.bus.zeromq.sockets import Longest, open_socket
from tactile_nodes.clock import SystemClock
from tactile_nodes.messages import types

FLOORS = ('pyzmq, copied', 'pyzmq, not copied')
RAW, NODE = 'bus, subscription', 'bus, node'
CONTENDERS = (*FLOORS, RAW, NODE)
PAYLOADS = ('image', 'features', 'wrench')
_QUEUE = 64  # the same for every contender, for equal conditions


def payload(name: str) -> Any:
    """The message for a payload: a 440x440 mono8 image, 3200 features, a wrench."""
    rng = np.random.default_rng(0)
    header = types.Header(frame_id='gel_camera_optical_frame')
    if name == 'image':
        pixels = rng.integers(0, 256, 440 * 440, np.uint8)
        return types.Image(header=header, height=440, width=440, encoding='mono8', step=440, data=pixels)
    if name == 'features':
        values, sure = rng.random(3200, np.float32), rng.random(1600, np.float32)
        return types.FlowFeatures(header=header, rows=40, cols=40, channels=2, values=values, confidence=sure)
    return types.WrenchStamped(header=header)


def topic_of(contender: str, name: str) -> Topic:
    """The topic of one contender and payload."""
    words = f'{contender} {name}'.replace(',', '').replace(' ', '_')
    return Topic(f'/bench/{words}', messages.type_name(payload(name)), '', Qos('queue', _QUEUE))


class Sender:
    """Sends each payload with each contender."""

    def __init__(self, bus: Bus, floor_address: str | None) -> None:
        self._clock = SystemClock()
        self._context = zmq.Context()
        self._messages = {name: payload(name) for name in PAYLOADS}
        self._bytes = {name: messages.encode(message) for name, message in self._messages.items()}
        self._send: dict[tuple[str, str], Callable[[], Any]] = {}
        for name in PAYLOADS:
            for contender in (RAW, NODE):
                self._add_publisher(bus, contender, name)
            for contender in FLOORS if floor_address else ():
                self._add_floor(f'{floor_address}.{FLOORS.index(contender)}.{name}', contender, name)

    def send(self, contender: str, name: str, count: int, period_ns: int) -> list[int]:
        """Send `count` messages, one per period (0: as fast as possible); returns when each was sent."""
        send = self._send[contender, name]
        handed_over = []
        due_ns = self._clock.now_ns()
        for _ in range(count):
            if period_ns:
                due_ns += period_ns
                self._clock.sleep_until(due_ns)
            handed_over.append(self._clock.now_ns())
            send()
        return handed_over

    def close(self) -> None:
        self._context.destroy(linger=0)

    def _add_publisher(self, bus: Bus, contender: str, name: str) -> None:
        topic = topic_of(contender, name)
        publisher = bus.advertise(topic.name, topic.type_name, topic.qos)
        message = self._messages[name]
        self._send[contender, name] = lambda: publisher.publish(message)

    def _add_floor(self, address: str, contender: str, name: str) -> None:
        socket = open_socket(self._context, zmq.PUB, Longest.WORD)
        socket.set(zmq.SNDHWM, _QUEUE)
        socket.bind(address)
        data, copy = self._bytes[name], contender == FLOORS[0]
        self._send[contender, name] = lambda: socket.send(data, 0, copy)


class Receiving(Protocol):
    """The receiver of one contender."""

    def begin(self) -> None:
        """Drop earlier messages."""
        ...

    def arrivals(self, count: int, idle_s: float) -> list[int]:
        """Times when the user had each message; fewer than `count` if none came for `idle_s`."""
        ...


class FloorReceiver:
    """A blocking ``recv`` in the main thread, without decoding."""

    def __init__(self, context: zmq.Context[Any], address: str, copy: bool) -> None:
        self._clock = SystemClock()
        self._copy = copy
        self._socket = open_socket(context, zmq.SUB, Longest.PICTURE)
        self._socket.set(zmq.RCVHWM, _QUEUE)
        self._socket.subscribe(b'')
        self._socket.connect(address)

    def begin(self) -> None:
        while self._socket.poll(0):
            self._socket.recv(zmq.NOBLOCK)

    def arrivals(self, count: int, idle_s: float) -> list[int]:
        self._socket.set(zmq.RCVTIMEO, int(idle_s * 1000))
        found: list[int] = []
        try:
            while len(found) < count:
                self._socket.recv(0, self._copy)
                found.append(self._clock.now_ns())
        except zmq.Again:
            return found
        return found


class RawReceiver:
    """A subscription that is read in the main thread."""

    def __init__(self, bus: Bus, topic: Topic) -> None:
        self._clock = SystemClock()
        self._subscription: Subscription = bus.subscribe(topic.name, topic.type_name, topic.qos)

    def begin(self) -> None:
        while self._subscription.take() is not None:
            pass

    def arrivals(self, count: int, idle_s: float) -> list[int]:
        found: list[int] = []
        while len(found) < count and (received := self._subscription.get(idle_s)) is not None:
            _ = received.message
            found.append(self._clock.now_ns())
        return found


class NodeReceiver(Node):
    """A node as users write it: its callback gets the decoded message."""

    def __init__(self, bus: Bus, topic: Topic) -> None:
        super().__init__(bus, parse_arguments(['--ros-args', '-r', f'__node:={topic.name.rpartition("/")[2]}']))
        self._found: list[int] = []
        self._count = -1
        self._complete = threading.Event()
        self.create_subscription(topic, self._on_message)
        threading.Thread(target=self.spin, daemon=True).start()

    def begin(self) -> None:
        self._complete.clear()
        self._count = -1
        self._found = []

    def arrivals(self, count: int, idle_s: float) -> list[int]:
        self._count = count
        before = -1
        while len(self._found) < count and not self._complete.wait(idle_s) and len(self._found) > before:
            before = len(self._found)
        return self._found[:count]

    def _on_message(self, received: Received) -> None:
        _ = received.message
        self._found.append(self.clock.now_ns())
        if len(self._found) == self._count:
            self._complete.set()


class Receiver:
    """Receives each payload with each contender."""

    def __init__(self, bus: Bus, floor_address: str | None) -> None:
        self._context = zmq.Context()
        self._ends: dict[tuple[str, str], Receiving] = {}
        for name in PAYLOADS:
            self._ends[RAW, name] = RawReceiver(bus, topic_of(RAW, name))
            self._ends[NODE, name] = NodeReceiver(bus, topic_of(NODE, name))
            for contender in FLOORS if floor_address else ():
                address = f'{floor_address}.{FLOORS.index(contender)}.{name}'
                self._ends[contender, name] = FloorReceiver(self._context, address, contender == FLOORS[0])

    def begin(self, contender: str, name: str) -> None:
        """Drop earlier messages."""
        self._ends[contender, name].begin()

    def arrivals(self, contender: str, name: str, count: int, idle_s: float) -> list[int]:
        """Times when the user had each message; fewer than `count` if none came for `idle_s`."""
        return self._ends[contender, name].arrivals(count, idle_s)

    def close(self) -> None:
        for end in self._ends.values():
            if isinstance(end, NodeReceiver):
                end.stop()
        self._context.destroy(linger=0)


class Inside:
    """Sender and receiver in one process, on the bus that its nodes share."""

    def __init__(self, bus: Bus) -> None:
        self._sender, self._receiver = Sender(bus, None), Receiver(bus, None)

    def measure(
        self, contender: str, name: str, count: int, period_ns: int, idle_s: float
    ) -> tuple[list[int], list[int]]:
        """Times when each message was sent, and when the user had it."""
        arrived: list[int] = []
        self._receiver.begin(contender, name)
        waiting = threading.Thread(
            target=lambda: arrived.extend(self._receiver.arrivals(contender, name, count, idle_s))
        )
        waiting.start()
        sent = self._sender.send(contender, name, count, period_ns)
        waiting.join()
        return sent, arrived

    def close(self) -> None:
        self._sender.close()
        self._receiver.close()
