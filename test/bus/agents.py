"""Other processes on the bus, each of which does what a test asks of it."""

from __future__ import annotations

import errno
import io
import multiprocessing
import os
import signal
import statistics
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from tactile_nodes.bus.node.parameters import to_message
from tactile_nodes.bus.protocol import Publisher, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.errors import ConfigurationError, TactileError
from tactile_nodes.messages import services, types

NUMBER = 'std_msgs/msg/Int64'
IMAGE = 'sensor_msgs/msg/Image'
QUEUE = Qos('queue', 1000)
DEADLINE_S = 30.0  # of hangs only: a busy machine may take long

_CONTEXT = multiprocessing.get_context('forkserver')
_CONTEXT.set_forkserver_preload(['agents', 'tactile_nodes.bus.zeromq.host_bus'])


def until(condition: Callable[[], Any], what: str = 'the condition', timeout_s: float = DEADLINE_S) -> Any:
    """What `condition` returns once that is true; fails the test when it does not come true in time."""
    deadline = time.monotonic() + timeout_s
    while True:
        if found := condition():
            return found
        assert time.monotonic() < deadline, f'waited {timeout_s} s for {what}'
        time.sleep(0.005)


def image(number: int) -> types.Image:
    data = np.full(440 * 440, number % 256, np.uint8)
    return types.Image(
        header=types.Header(stamp=types.Time(nanosec=number)), height=440, width=440, step=440, data=data
    )


def number_of(received: Received) -> int:
    message = received.message
    return int(message.data if received.type_name == NUMBER else message.header.stamp.nanosec)


def got(subscription: Subscription) -> Received:
    """The next message, which must come."""
    received = subscription.get(DEADLINE_S)
    assert received is not None, f'nothing on {subscription.topic}'
    return received


def numbers_of(subscription: Subscription) -> list[int]:
    """Those that came since."""
    return [number_of(received) for received in iter(subscription.take, None)]


def connected(
    join: Callable[[], ZmqBus], topic: str = '/n', type_name: str = NUMBER
) -> tuple[ZmqBus, Publisher, Subscription]:
    """Two participants, of whom one hears the other: that one, and both ends."""
    publishing, listening = join(), join()
    publisher, subscription = (make(topic, type_name, QUEUE) for make in (publishing.advertise, listening.subscribe))
    until(lambda: publisher.listeners == 1, 'a connection')
    return publishing, publisher, subscription


class FullDisk(io.StringIO):
    """A stream that is redirected to a file for which there is no room."""

    def write(self, text: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class Agent:
    """The methods of this class run in the other process."""

    def __init__(self, folder: str, domain_id: int | None) -> None:
        self.bus = ZmqBus(domain_id, folder=Path(folder))
        self.publishers: dict[str, Publisher] = {}
        self.subscriptions: dict[str, Subscription] = {}
        self.received_so_far: dict[str, list[int]] = {}
        self.marks_so_far: dict[str, list[tuple[str, int, int]]] = {}
        self.sent_so_far: dict[str, list[int]] = {}
        self.published = 0
        self.calls = 0

    def advertise(self, topic: str, type_name: str = NUMBER, qos: Qos = QUEUE) -> None:
        self.publishers[topic] = self.bus.advertise(topic, type_name, qos, '/agent')

    def say(self, topic: str, *numbers: int) -> None:
        made = self.publishers[topic]
        self.sent_so_far.setdefault(topic, []).extend(numbers)
        for number in numbers:
            made.publish(types.Int64(data=number) if made.type_name == NUMBER else image(number))

    def takes_s(self, topic: str, times: int) -> float:
        """How long it takes to publish, at the median of so many times: some are interrupted by other processes."""
        taken_s = []
        for _ in range(times):
            begin_s = time.perf_counter()
            self.say(topic, 1)
            taken_s.append(time.perf_counter() - begin_s)
        return statistics.median(taken_s)

    def talk(self, topic: str, period_s: float) -> None:
        """Go on publishing 1, 2, 3, … in a thread."""

        def forever() -> None:
            while True:
                self.published += 1
                self.say(topic, self.published)
                time.sleep(period_s)

        threading.Thread(target=forever, daemon=True).start()

    def count_published(self) -> int:
        return self.published

    def listen(self, topic: str, type_name: str = NUMBER, qos: Qos = QUEUE) -> None:
        self.subscriptions[topic] = self.bus.subscribe(topic, type_name, qos, '/agent')
        self.received_so_far[topic] = []
        self.marks_so_far[topic] = []

    def received(self, topic: str) -> list[int]:
        """All numbers that were received since `listen`."""
        while (received := self.subscriptions[topic].take()) is not None:
            self.received_so_far[topic].append(number_of(received))
            self.marks_so_far[topic].append((received.publisher, received.sequence, received.source_ns))
        return self.received_so_far[topic]

    def marks(self, topic: str) -> list[tuple[str, int, int]]:
        """Publisher, number and stamp of all that was received since `listen`."""
        self.received(topic)
        return self.marks_so_far[topic]

    def sent(self, topic: str) -> list[int]:
        return self.sent_so_far.get(topic, [])

    def serve(self, name: str, behaviour: str) -> None:
        def handle(request: Any, reply: Callable[[Any], None]) -> None:
            self.calls += 1
            if behaviour == 'answer':
                reply(types.Trigger_Response(success=True, message=f'from {os.getpid()}'))
            elif behaviour == 'refuse':
                reply(ConfigurationError('not today'))
            elif behaviour == 'raise':
                raise RuntimeError('a bug')
            elif behaviour == 'nonsense':
                reply(types.Int64(data=1))

        self.bus.serve(name, services.TRIGGER, handle, '/agent')

    def count_calls(self) -> int:
        return self.calls

    def call(self, name: str, timeout_s: float = DEADLINE_S) -> str:
        try:
            return str(self.bus.call(name, services.TRIGGER, types.Trigger_Request(), timeout_s).message)
        except TactileError as error:
            return f'{type(error).__name__}: {error}'

    def set_parameter(self, node: str, name: str, value: float) -> tuple[bool, str] | None:
        request = types.SetParameters_Request(parameters=[types.Parameter(name=name, value=to_message(value))])
        try:
            (result,) = self.bus.call(f'{node}/set_parameters', services.SET_PARAMETERS, request).results
        except TactileError:
            return None
        return result.successful, result.reason

    def add_node(self, name: str) -> None:
        self.bus.add_node(name)

    def nodes(self) -> list[str]:
        return self.bus.graph().nodes()

    def pid(self) -> int:
        return os.getpid()

    def addresses(self) -> list[str]:
        """What this process listens on, on any network."""
        return [str(entry.laddr) for entry in psutil.Process().net_connections('inet')]

    def resident_bytes(self) -> int:
        return int(psutil.Process().memory_info().rss)

    def close(self) -> None:
        self.bus.close()


class Other:
    """A handle on another process: ``other.say('/t', 1)`` runs `Agent.say` there."""

    def __init__(self, folder: Path, domain_id: int | None = 7, environment: dict[str, str] | None = None) -> None:
        self._pipe, theirs = _CONTEXT.Pipe()
        self._process = _CONTEXT.Process(
            target=_obey, args=(theirs, str(folder), domain_id, environment or {}), daemon=True
        )
        self._process.start()
        theirs.close()
        assert self._answer() == 'ready'

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def ask(*args: Any) -> Any:
            self._pipe.send((name, args))
            return self._answer()

        return ask

    def begin(self, name: str, *args: Any) -> Callable[[], Any]:
        """Ask without waiting; returns the function that waits for the answer."""
        self._pipe.send((name, args))
        return self._answer

    def signal(self, number: signal.Signals) -> None:
        assert self._process.pid is not None
        os.kill(self._process.pid, number)
        if number == signal.SIGKILL:
            self._process.join(DEADLINE_S)
        if number == signal.SIGSTOP:
            process = psutil.Process(self._process.pid)
            until(lambda: process.status() == psutil.STATUS_STOPPED, 'it to stop')

    def end(self) -> None:
        self._process.kill()
        self._process.join()
        self._process.close()
        self._pipe.close()

    def _answer(self) -> Any:
        assert self._pipe.poll(2 * DEADLINE_S), 'the other process does not answer'
        answer = self._pipe.recv()
        if isinstance(answer, BaseException):
            raise answer
        return answer


def _obey(pipe: Connection, folder: str, domain_id: int | None, environment: dict[str, str]) -> None:
    os.environ.update(environment)
    sys.stderr = io.StringIO()  # bugs that tests provoke there are no news
    try:
        agent = Agent(folder, domain_id)
    except TactileError as error:
        pipe.send(error)
        return
    pipe.send('ready')
    while True:
        name, args = pipe.recv()
        try:
            pipe.send(getattr(agent, name)(*args))
        except Exception as error:  # noqa: BLE001 - it is raised in the test
            pipe.send(error)
