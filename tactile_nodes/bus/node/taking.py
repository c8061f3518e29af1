"""How a thread waits for the work that others give it."""

from __future__ import annotations

import queue
from typing import TypeVar

Work = TypeVar('Work')


def take(waiting: queue.SimpleQueue[Work], timeout_s: float | None) -> Work:
    """The oldest entry, waiting for one; for ever if `timeout_s` is None. For the only thread that takes.

    ``SimpleQueue.get`` of CPython first takes the queue's lock if that is free, as it is before the first call and
    after an entry. It then works out how much time is left, and if none is left by then it waits for ever (seen in
    3.11 with a timeout of 1 µs; a thread that the operating system puts aside just there may lose milliseconds). A look
    without waiting takes that lock before.

    Raises:
        queue.Empty: nothing came in time.
    """
    try:
        return waiting.get_nowait()
    except queue.Empty:
        if timeout_s == 0.0:
            raise
    return waiting.get(timeout=timeout_s)
