"""Publishers, subscriptions, services and clients."""

from __future__ import annotations

import inspect
import itertools
import time
from enum import Enum
from typing import Any

from rclpy import network
from rclpy.executors import await_or_execute
from rclpy.serialization import deserialize_message, on_the_wire
from rclpy.task import Future


class _End:
    def __init__(self, node: Any) -> None:
        self.node = node
        self.destroyed = False

    def check(self) -> None:
        if self.destroyed:
            raise RuntimeError('InvalidHandle: cannot use Destroyable because destruction was requested')


class Publisher(_End):
    def __init__(self, node: Any, msg_type: Any, topic: str, qos_profile: Any) -> None:
        super().__init__(node)
        self.msg_type, self.topic, self.qos_profile = msg_type, topic, qos_profile
        self.kept: list[bytes] = []

    def publish(self, msg: Any) -> None:
        self.check()
        if isinstance(msg, self.msg_type):
            network.carry(self, on_the_wire(msg))
        elif isinstance(msg, bytes):
            network.carry(self, msg)
        else:
            raise TypeError(f'Expected {self.msg_type}, got {type(msg)}')

    def get_subscription_count(self) -> int:
        self.check()
        return len(network.matched(self))


class _Waiting(_End):
    """An end at which something can arrive."""

    def __init__(self, node: Any, callback_group: Any) -> None:
        super().__init__(node)
        self.callback_group = callback_group
        self.queue: list[Any] = []

    def is_ready(self) -> bool:
        return bool(self.queue) and not self.destroyed

    def take(self) -> Any:
        with network.LOCK:
            return self.queue.pop(0) if self.queue and not self.destroyed else None

    def wake(self) -> None:
        if self.node.executor is not None:
            self.node.executor.wake()


class Subscription(_Waiting):
    CallbackType = Enum('CallbackType', ['MessageOnly', 'WithMessageInfo'])
    """Humble's class has none: there callbacks get the message alone."""

    def __init__(
        self, node: Any, msg_type: Any, topic: str, callback: Any, qos_profile: Any, callback_group: Any, raw: bool
    ) -> None:
        super().__init__(node, callback_group)
        self.msg_type, self.topic, self.callback, self.qos_profile, self.raw = (
            msg_type, topic, callback, qos_profile, raw
        )  # fmt: skip
        self._with_info = False
        try:
            inspect.signature(callback).bind(object())
        except TypeError:
            inspect.signature(callback).bind(object(), object())
            self._with_info = hasattr(Subscription, 'CallbackType')

    def arrive(self, data: bytes) -> None:
        info = {'source_timestamp': time.time_ns(), 'received_timestamp': time.time_ns()}
        self.queue = network.keep(self.qos_profile, [*self.queue, (data, info)])
        self.wake()

    async def execute(self, executor: Any, taken: Any) -> None:
        del executor
        data, info = taken
        message = data if self.raw else deserialize_message(data, self.msg_type)
        await await_or_execute(self.callback, *((message, info) if self._with_info else (message,)))


class Service(_Waiting):
    def __init__(self, node: Any, srv_type: Any, srv_name: str, callback: Any, callback_group: Any) -> None:
        super().__init__(node, callback_group)
        self.srv_type, self.srv_name, self.callback = srv_type, srv_name, callback

    async def execute(self, executor: Any, taken: Any) -> None:
        del executor
        data, client, number = taken
        request = deserialize_message(data, self.srv_type.Request)
        response = await await_or_execute(self.callback, request, self.srv_type.Response())
        if not isinstance(response, self.srv_type.Response):
            raise TypeError
        client.queue.append((on_the_wire(response), number))
        client.wake()


class Client(_Waiting):
    def __init__(self, node: Any, srv_type: Any, srv_name: str, callback_group: Any) -> None:
        super().__init__(node, callback_group)
        self.srv_type, self.srv_name = srv_type, srv_name
        self._pending: dict[int, Future] = {}
        self._numbers = itertools.count(1)

    def service_is_ready(self) -> bool:
        return bool(network.servers(self.node, self.srv_name, self.srv_type))

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        left_s = float('inf') if timeout_sec is None else timeout_sec
        while self.node.context.ok() and not self.service_is_ready() and left_s > 0.0:
            time.sleep(0.25)
            left_s -= 0.25
        return self.service_is_ready()

    def call_async(self, request: Any) -> Future:
        if not isinstance(request, self.srv_type.Request):
            raise TypeError
        future, number = Future(), next(self._numbers)
        self._pending[number] = future
        for server in network.servers(self.node, self.srv_name, self.srv_type):
            server.queue.append((on_the_wire(request), self, number))
            server.wake()
        return future

    def remove_pending_request(self, future: Future) -> None:
        self._pending = {number: entry for number, entry in self._pending.items() if entry is not future}

    async def execute(self, executor: Any, taken: Any) -> None:
        data, number = taken
        future = self._pending.pop(number, None)
        if future is not None:
            future._set_executor(executor)
            future.set_result(deserialize_message(data, self.srv_type.Response))
