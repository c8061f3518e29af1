"""A thread that waits on sockets, and does what others post to it."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable
from typing import Any

import zmq

Action = Callable[[], None]


class Loop(threading.Thread):
    """Owns sockets, which nobody else may touch; others reach it by `post`. Subclasses do their rounds in `tick`.

    Nothing that comes in may end it: what an action raises is a bug of ours, said once, and the loop goes on.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name=name, daemon=True)
        self.faults = 0
        self._reported: set[str] = set()
        self._running = True
        self._poller = zmq.Poller()
        self._on_readable: dict[Any, Action] = {}
        self._posted: deque[Action] = deque()
        self._waking = threading.Lock()
        self._woken, self._waker = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self.watch(self._woken, self._do_posted)

    def watch(self, socket: Any, on_readable: Action) -> None:
        """Call `on_readable` in this thread whenever there is something to read; before `start` or in this thread."""
        self._poller.register(socket, zmq.POLLIN)
        self._on_readable[socket] = on_readable

    def forget(self, socket: Any) -> None:
        """The reverse of `watch`; in this thread."""
        self._poller.unregister(socket)
        del self._on_readable[socket]

    def post(self, action: Action) -> None:
        """Do something in this thread, soon; when it has ended, nothing happens."""
        with self._waking:
            if self._waker < 0:
                return
            self._posted.append(action)
            try:
                os.write(self._waker, b'!')
            except BlockingIOError:  # a full pipe wakes as well as a fuller one
                return

    def stop(self) -> None:
        """End the thread, after what was posted before; its sockets are closed when this returns."""
        self.post(self._end)
        if self.is_alive():
            self.join()
        with self._waking:
            for descriptor in {self._woken, self._waker} - {-1}:
                os.close(descriptor)
            self._woken = self._waker = -1

    def run(self) -> None:
        while self._running:
            for socket, _ in self._poller.poll(self.wait_ms()):
                self._guarded(self._on_readable.get(socket))
            self._guarded(self.tick)
        self._guarded(self.finish)

    def wait_ms(self) -> int:
        """For how long to wait for something to read."""
        return 1000

    def tick(self) -> None:
        """What there is to do after each wait."""

    def finish(self) -> None:
        """Close the sockets, as the thread's last act."""

    def _guarded(self, action: Action | None) -> None:
        try:
            if action is not None:
                action()
        except Exception:  # noqa: BLE001 - a bug in one handler must not make the whole process deaf
            self.faults += 1
            text = traceback.format_exc()
            if text not in self._reported:
                self._reported.add(text)
                with contextlib.suppress(OSError):  # a full disk, a closed pipe
                    sys.stderr.write(f'a bug in the thread {self.name!r}, which continues:\n{text}')

    def _end(self) -> None:
        self._running = False

    def _do_posted(self) -> None:
        try:
            os.read(self._woken, 4096)
        except BlockingIOError:  # its byte was read with an earlier one
            return
        while self._posted:
            self._guarded(self._posted.popleft())
