"""The receiving end of a topic: a bounded buffer that never blocks a publisher."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from tactile_nodes.clock import monotonic_s

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import Qos, Received

_MOST_PUBLISHERS = 1000
FOR_EVER = -1.0  # as the timeout of a lock


class Subscription:
    """Buffers received messages; when it is full, the oldest is dropped and counted in `dropped`.

    `received` counts received messages, `malformed` the frames that are not messages of this topic. With `only`,
    messages of all other publishers are ignored.
    """

    def __init__(
        self,
        topic: str,
        type_name: str,
        qos: Qos,
        node: str,
        on_ready: Callable[[], None] | None,
        on_close: Callable[[Subscription], None],
        only: str = '',
    ) -> None:
        self.topic = topic
        self.type_name = type_name
        self.qos = qos
        self.node = node
        self.received = 0
        self.dropped = 0
        self.malformed = 0
        self._waiting: deque[Received] = deque(maxlen=max(1, qos.depth))
        self._newest: dict[str, int] = {}
        self._lock = threading.Lock()
        self._getting: list[threading.Lock] = []  # one lock for each waiting thread; a released one looks again
        self._only = only
        self._on_ready = on_ready
        self._on_close = on_close
        self._closed = False

    def put(self, received: Received) -> None:
        """Called by the transport, from any thread; returns at once.

        A message older than the last one of the same publisher is ignored: a latched message that was sent again for
        another subscriber, or one that arrived by two routes.
        """
        with self._lock:
            if self._closed or (self._only and received.publisher != self._only):
                return
            if received.sequence <= self._newest.get(received.publisher, 0):
                return
            self._newest[received.publisher] = received.sequence
            if len(self._newest) > _MOST_PUBLISHERS:
                del self._newest[next(iter(self._newest))]
            self.received += 1
            self.dropped += len(self._waiting) == self._waiting.maxlen
            self._waiting.append(received)
            self._wake()
        if self._on_ready is not None:
            self._on_ready()

    @property
    def waiting(self) -> int:
        """The number of buffered messages."""
        return len(self._waiting)

    def take(self) -> Received | None:
        """The oldest buffered message, or None."""
        try:
            return self._waiting.popleft()
        except IndexError:
            return None

    def get(self, timeout_s: float | None = None) -> Received | None:
        """The oldest buffered message; waits for one, and returns None after `timeout_s` or when closed.

        Ctrl-C may raise an exception between any two steps, and must not leave a lock held that `put` needs. ``with``
        does: since Python 3.14, an exception may come between taking the lock and the block. So this takes none.
        """
        end_s = None if timeout_s is None else monotonic_s() + timeout_s
        while True:
            woken = threading.Lock()
            woken.acquire()
            self._getting.append(woken)  # before looking, so that a message that comes after wakes it
            ended, left_s = self._closed, FOR_EVER if end_s is None else max(0.0, end_s - monotonic_s())
            found = self.take()
            if found is None and left_s and not ended:
                woken.acquire(timeout=min(left_s, threading.TIMEOUT_MAX))
            with suppress(ValueError):  # not there: it was woken
                self._getting.remove(woken)
            if found is not None or ended or not left_s:
                return found

    def close(self) -> None:
        """Stop receiving; closing twice is harmless."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._wake()
        self._on_close(self)

    def _wake(self) -> None:
        """Make all waiting threads look again."""
        with suppress(IndexError):  # no more of them
            while True:
                self._getting.pop().release()
