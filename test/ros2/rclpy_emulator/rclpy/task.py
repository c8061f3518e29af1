"""Futures and tasks as rclpy 7.1.8 has them: a waiting coroutine is looked at when the executor spins."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable, Generator
from typing import Any


class Future:
    def __init__(self, *, executor: Any = None) -> None:
        self._done = False
        self._result: Any = None
        self._exception: Exception | None = None
        self._callbacks: list[Callable[[Any], None]] = []
        self._lock = threading.Lock()
        self._executor = executor

    def __await__(self) -> Generator[None, None, Any]:
        while not self._done:
            yield
        return self.result()

    def done(self) -> bool:
        return self._done

    def result(self) -> Any:
        if self._exception:
            raise self._exception
        return self._result

    def exception(self) -> Exception | None:
        return self._exception

    def set_result(self, result: Any) -> None:
        self._finish(result, None)

    def set_exception(self, exception: Exception) -> None:
        self._finish(None, exception)

    def _set_executor(self, executor: Any) -> None:
        self._executor = executor

    def add_done_callback(self, callback: Callable[[Any], None]) -> None:
        with self._lock:
            if not self._done:
                self._callbacks.append(callback)
                return
        callback(self)

    def _finish(self, result: Any, exception: Exception | None) -> None:
        with self._lock:
            self._result, self._exception, self._done = result, exception, True
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            if self._executor is not None:
                self._executor.create_task(callback, self)
            else:
                callback(self)


class Task(Future):
    """A function or coroutine that an executor runs; a call goes on with it."""

    def __init__(self, handler: Any, args: tuple[Any, ...] = (), executor: Any = None) -> None:
        super().__init__(executor=executor)
        self._handler = handler(*args) if inspect.iscoroutinefunction(handler) else handler
        self._args = args

    def __call__(self) -> None:
        if self._done:
            return
        try:
            if inspect.iscoroutine(self._handler):
                self._handler.send(None)
            else:
                self.set_result(self._handler(*self._args))
        except StopIteration as ended:
            self.set_result(ended.value)
        except Exception as error:  # noqa: BLE001 - as rclpy: the executor raises it
            self.set_exception(error)
