"""The executor: one callback a spin, in the thread that spins."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Iterator
from typing import Any

from rclpy.context import Context
from rclpy.task import Task


class ExternalShutdownException(Exception):  # noqa: N818 - its name
    pass


class SingleThreadedExecutor:
    """Its guard stays triggered until seen; a coroutine that waits is polled once before each wait, and no oftener."""

    def __init__(self, *, context: Context) -> None:
        self._context = context
        self._nodes: list[Any] = []
        self._tasks: list[tuple[Task, Any]] = []
        self._changed = threading.Condition()
        self._triggered = False
        self._is_shutdown = False
        self._work: Iterator[Task] | None = None

    def add_node(self, node: Any) -> bool:
        with self._changed:
            self._nodes.append(node)
        node.executor = self
        self.wake()
        return True

    def remove_node(self, node: Any) -> None:
        with self._changed:
            if node in self._nodes:
                self._nodes.remove(node)
        self.wake()

    def create_task(self, callback: Any, *args: Any) -> Task:
        task = Task(callback, args, executor=self)
        with self._changed:
            self._tasks.append((task, None))
        self.wake()
        return task

    def wake(self) -> None:
        with self._changed:
            self._triggered = True
            self._changed.notify_all()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """As rclpy's: woken without anything to do, it goes on waiting."""
        while not self._is_shutdown:
            if self._work is None:
                self._work = self._ready(timeout_sec)
            task = next(self._work, None)
            if task is None:
                self._work = None
                if timeout_sec is not None:
                    return
                continue
            task()
            if task.exception() is not None:
                raise task.exception()  # type: ignore[misc]
            return

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        del timeout_sec
        self._is_shutdown = True
        self.wake()
        return True

    def _ready(self, timeout_sec: float | None) -> Iterator[Task]:
        with self._changed:
            self._tasks = [(task, entity) for task, entity in self._tasks if not task.done()]
            waiting = [task for task, _ in self._tasks]
        yield from waiting
        with self._changed:
            self._changed.wait_for(lambda: self._triggered or self._is_shutdown, timeout_sec)
            self._triggered = False
            nodes = list(self._nodes)
        if not self._context.ok():
            raise ExternalShutdownException
        for node in nodes:
            for entity in node.entities():
                while entity.is_ready() and entity.callback_group.can_execute():
                    yield self._handler(entity)

    def _handler(self, entity: Any) -> Task:
        async def handle() -> None:
            entity.callback_group.begin()
            try:
                taken = entity.take()
                if taken is not None:
                    await entity.execute(self, taken)
            finally:
                entity.callback_group.end()
                self.wake()

        task = Task(handle, (), executor=self)
        with self._changed:
            self._tasks.append((task, entity))
        return task


async def await_or_execute(callback: Any, *args: Any) -> Any:
    """The result of a function or of a coroutine."""
    return await callback(*args) if inspect.iscoroutinefunction(callback) else callback(*args)
